"""The part of a world that a goal can use: the facts for the logic program and for PDDL."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planner.routing_graph import Endpoint
from planner.tasks.goal import Goal, Word
from planner.tasks.world import TaskState
from semmap.error import Error


class NoPlanError(Error, ValueError):
    """No plan reaches the goal; the message says why."""


@dataclass(frozen=True)
class Operator:
    """An action of a domain file with objects; facts are tuples of a predicate and names."""

    name: str
    arguments: tuple[str, ...]
    seconds: float
    at: str | None
    held: tuple[str, ...] = ()
    on: tuple[tuple[str, str], ...] = ()
    needs: tuple[tuple[str, ...], ...] = ()
    needs_not: tuple[tuple[str, ...], ...] = ()
    adds: tuple[tuple[str, ...], ...] = ()
    deletes: tuple[tuple[str, ...], ...] = ()

    @property
    def facts(self) -> tuple[tuple[str, ...], ...]:
        """All facts that it needs or changes."""
        return (*self.adds, *self.deletes, *self.needs, *self.needs_not)


@dataclass
class Problem:
    """A goal over the part of a world that it can use."""

    goal: Goal
    state: TaskState
    capacity: int
    pickup: float  # seconds
    place: float  # seconds
    candidates: dict[Word, list[str]] = field(default_factory=dict)  # for each word
    differ: list[tuple[Word, Word]] = field(default_factory=list)  # words of two objects
    regions: dict[Word, list[str]] = field(default_factory=dict)  # for each word
    limits: dict[str, int] = field(default_factory=dict)  # most pickups of each movable object
    takes: dict[str, list[str]] = field(default_factory=dict)  # what may be put there
    carriers: set[str] = field(default_factory=set)  # carried with what is on them
    on: dict[str, str] = field(default_factory=dict)  # what each object is on at first
    held: list[str] = field(default_factory=list)  # what the robot carries
    spots: dict[str, int] = field(default_factory=dict)  # the site of each object
    fixed: set[str] = field(default_factory=set)  # the objects that never move
    sites: list[Endpoint] = field(default_factory=list)  # the first is the robot's
    seconds: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 1)))
    finals: list[tuple[int, str]] = field(default_factory=list)  # sites, places
    operators: list[Operator] = field(default_factory=list)
    facts: list[tuple[str, ...]] = field(default_factory=list)
    slots: int = 0  # most events of a plan
    refused: list[str] = field(default_factory=list)  # why surfaces are not used


def join_reasons(reasons: Sequence[str], most: int = 3) -> str:
    """The first reasons against candidates, without repetition, as one message."""
    each = list(dict.fromkeys(reasons))
    more = f"; and {len(each) - most} more" if len(each) > most else ""
    return "; ".join(each[:most]) + more


def milliseconds(seconds: float) -> int:
    """Whole milliseconds, in which plans are compared."""
    return round(1000.0 * seconds)
