"""Limits the pickups of each object, and the number of events of a plan."""

from __future__ import annotations

from collections.abc import Iterable

from planner.tasks.goal_objects import GoalObjects
from planner.tasks.object_checks import ObjectChecks
from planner.tasks.problem_draft import ProblemDraft


def limit_pickups(
    draft: ProblemDraft, checks: ObjectChecks, objects: GoalObjects, moved: Iterable[str]
) -> dict[str, None]:
    """Limit the pickups of the objects that are moved; returns those to be put aside."""
    problem, world = draft.problem, draft.world
    limits = dict.fromkeys(moved, 1)
    aside = dict.fromkeys(off for name in limits for off in checks.tucked.get(name, ()))
    for word, names in problem.candidates.items():
        if word in objects.wanted and all(n in limits for n in names):
            continue
        for name in names:  # space is made on a target
            if checks.needs_space(world.objects[name]):
                for above in world.above.get(name, ()):
                    if checks.obstacle(above) is None:
                        aside.update(dict.fromkeys([above, *checks.tucked[above]]))
    for off in aside:
        limits[off] = limits.get(off, 0) + 1
    for name in problem.held:
        limits.setdefault(name, 1 if name in objects.surfaces else 0)
    problem.limits = limits
    return aside


def count_slots(draft: ProblemDraft, checks: ObjectChecks, more: int) -> None:
    """Set the maximum number of events of a plan; `more` of them are those of a domain file."""
    problem = draft.problem

    def events(names: Iterable[str]) -> int:
        return sum(2 * problem.limits.get(n, 0) + (n in problem.held) for n in set(names))

    several: list[int] = []
    sure: set[str] = set(problem.held)
    for names in problem.candidates.values():
        groups = [{n, *checks.tucked.get(n, ())} | _off_target(draft, checks, n) for n in names]
        if len(groups) == 1:
            sure |= groups[0]
        else:
            several.append(max(map(events, groups)))
    problem.slots = events(sure) + sum(several) + more


def _off_target(draft: ProblemDraft, checks: ObjectChecks, name: str) -> set[str]:
    """The objects to take off a target."""
    found: set[str] = set()
    if checks.needs_space(draft.world.objects[name]):
        for above in draft.world.above.get(name, ()):
            found |= {above, *checks.tucked.get(above, ())}
    return found
