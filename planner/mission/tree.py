"""A plan as a behaviour tree: a sequence of stages under a guard that is asked at every tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Sequence as Steps

from planner.mission.behaviours import Doing, Outcome
from planner.mission.stage import Stage

__all__ = ["Hands", "mission_tree"]


class Hands(Protocol):
    """What the tree's leaves do, each for a stage by its number in the plan."""

    def guard(self) -> bool:
        """Whether the mission still goes on."""
        ...

    def claim(self, index: int) -> bool | None:
        """True once the robot has what it needs for itself; None while it waits; False: no more."""
        ...

    def begin(self, index: int) -> Doing | None:
        """Write that it begins, and let the robot act; None where it cannot begin."""
        ...

    def end(self, index: int, outcome: Outcome) -> None:
        """Write how it ended, and what came of it."""
        ...


def mission_tree(stages: Sequence[Stage], hands: Hands) -> Behaviour:
    """The tree of these stages; it succeeds when the last has, and fails with the first that does.

    A guard that fails stops the stage that is at work.
    """
    tasks = Steps("stages", memory=True)
    for index, stage in enumerate(stages):
        tasks.add_child(
            Steps(
                str(stage),
                memory=True,
                children=[
                    _Ask("claim", lambda index=index: hands.claim(index)),  # type: ignore[misc]
                    _Act(str(stage), hands, index),
                ],
            )
        )
    return Steps("mission", memory=False, children=[_Ask("guard", hands.guard), tasks])


class _Ask(Behaviour):
    """A question: yes, no, or not yet."""

    def __init__(self, name: str, ask: Callable[[], bool | None]) -> None:
        super().__init__(name)
        self._ask = ask

    def update(self) -> Status:
        answer = self._ask()
        if answer is None:
            return Status.RUNNING
        return Status.SUCCESS if answer else Status.FAILURE


class _Act(Behaviour):
    """One stage at work."""

    def __init__(self, name: str, hands: Hands, index: int) -> None:
        super().__init__(name)
        self._hands = hands
        self._index = index
        self._doing: Doing | None = None

    def initialise(self) -> None:
        self._doing = self._hands.begin(self._index)

    def update(self) -> Status:
        if self._doing is None:
            return Status.FAILURE
        outcome = self._doing.poll()
        if outcome is None:
            return Status.RUNNING
        self._doing = None
        self._hands.end(self._index, outcome)
        return Status.SUCCESS if outcome.succeeded else Status.FAILURE

    def terminate(self, new_status: Status) -> None:
        if new_status is Status.INVALID and self._doing is not None:
            doing, self._doing = self._doing, None
            doing.cancel()
            self._hands.end(self._index, Outcome("cancelled", "stopped in the middle"))
