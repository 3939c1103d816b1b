"""Chains of actions that have one cause and one effect each."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Sequence

from semmap.belief.error import BeliefError
from semmap.belief.teaching import KnownAction
from semmap.suggestions import suggestion


def action_chain(
    actions: Sequence[KnownAction],
    goal: str,
    is_a: Callable[[str, str], bool],
    given: Collection[str] = (),
) -> list[KnownAction]:
    """Return the shortest chain of actions that brings about a goal, the first action first.

    An action does so if its effect is a kind of the goal, or the goal a kind of its effect. `is_a`
    says whether the first name is the second one or a kind of it. A cause that no action brings
    about, or that is `given`, ends the chain. `BeliefError` if there is no chain.

    Examples
    --------
    >>> fetch = KnownAction("grasp", "object_found", "object_held")
    >>> bring = KnownAction("bring", "object_held", "object_delivered")
    >>> chain = action_chain([bring, fetch], "object_delivered", str.__eq__)
    >>> [action.name for action in chain]
    ['grasp', 'bring']
    """

    def achieving(name: str) -> list[KnownAction]:
        return [a for a in actions if is_a(a.effect, name) or is_a(name, a.effect)]

    if any(is_a(fact, goal) for fact in given):
        return []
    if not achieving(goal):
        effects = [action.effect for action in actions]
        raise BeliefError(f"no action brings about {goal}{suggestion(goal, effects, 'teach one')}")
    found: deque[tuple[str, list[KnownAction]]] = deque([(goal, [])])
    visited = {goal}
    while found:
        name, chain = found.popleft()
        before = achieving(name)
        if chain and (not before or any(is_a(fact, name) for fact in given)):
            return chain
        for action in before:
            if action.cause not in visited:
                visited.add(action.cause)
                found.append((action.cause, [action, *chain]))
    raise BeliefError(f"each chain of actions that brings about {goal} needs itself")
