"""A plan as a behaviour tree: a sequence of commands under a guard that is checked each tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Sequence as Steps

from planner.mission.behaviours import Outcome, RunningBehaviour
from planner.mission.command import Command


class StepHandlers(Protocol):
    """Executes the leaves of the tree, each for a command by its index in the plan."""

    def guard(self) -> bool:
        """Whether the mission continues."""
        ...

    def claim(self, index: int) -> bool | None:
        """True if the robot has its claim; None while it waits; False if it gives up."""
        ...

    def begin(self, index: int) -> RunningBehaviour | None:
        """Store that the command begins, and start it; None if it cannot begin."""
        ...

    def end(self, index: int, outcome: Outcome) -> None:
        """Store how the command ended, and its effects."""
        ...


def mission_tree(commands: Sequence[Command], handlers: StepHandlers) -> Behaviour:
    """The tree of these commands: fails with the first that fails, succeeds with the last.

    A guard that fails stops the running command.
    """
    tasks = Steps("commands", memory=True)
    for index, command in enumerate(commands):
        tasks.add_child(
            Steps(
                str(command),
                memory=True,
                children=[
                    _Ask("claim", lambda index=index: handlers.claim(index)),  # type: ignore[misc]
                    _Act(str(command), handlers, index),
                ],
            )
        )
    return Steps("mission", memory=False, children=[_Ask("guard", handlers.guard), tasks])


class _Ask(Behaviour):
    """A condition: true, false, or not known yet."""

    def __init__(self, name: str, ask: Callable[[], bool | None]) -> None:
        super().__init__(name)
        self._ask = ask

    def update(self) -> Status:
        answer = self._ask()
        if answer is None:
            return Status.RUNNING
        return Status.SUCCESS if answer else Status.FAILURE


class _Act(Behaviour):
    """A running command."""

    def __init__(self, name: str, handlers: StepHandlers, index: int) -> None:
        super().__init__(name)
        self._handlers = handlers
        self._index = index
        self._doing: RunningBehaviour | None = None

    def initialise(self) -> None:
        self._doing = self._handlers.begin(self._index)

    def update(self) -> Status:
        if self._doing is None:
            return Status.FAILURE
        outcome = self._doing.poll()
        if outcome is None:
            return Status.RUNNING
        self._doing = None
        self._handlers.end(self._index, outcome)
        return Status.SUCCESS if outcome.succeeded else Status.FAILURE

    def terminate(self, new_status: Status) -> None:
        if new_status is Status.INVALID and self._doing is not None:
            doing, self._doing = self._doing, None
            doing.cancel()
            self._handlers.end(self._index, Outcome("cancelled", "stopped in the middle"))
