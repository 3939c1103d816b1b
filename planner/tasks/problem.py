"""The part of a world that a goal can use: the facts for the logic program and for PDDL."""

from __future__ import annotations

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
    """An action of a domain file whose parameters are objects.

    Facts are tuples of a predicate and names.
    """

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


@dataclass
class Problem:
    """A goal over the part of a world that it can use.

    Attributes
    ----------
    goal, state, capacity
        As given.
    pickup, place
        Seconds.
    candidates
        The objects that each word of the goal may stand for.
    differ
        Pairs of words that stand for different objects.
    regions
        The places, or regions of places, that each word of the goal may stand for.
    limits
        Maximum pickups of each movable object.
    takes
        The movable objects that may be put on each object, or on the floor of a place.
    carriers
        The movable objects that are carried with the objects on them.
    on, held
        What each object is on at first, and the objects that the robot carries.
    spots
        Number of the site at which the robot reaches each object.
    fixed
        The objects that never move.
    sites
        The first is that of the robot.
    seconds
        (n, n) float64 between sites; infinite without a route.
    finals
        Sites at which the robot may end, each with the place or region that it reaches there.
    operators, facts
        Of a domain file.
    slots
        Maximum number of events of a plan.
    """

    goal: Goal
    state: TaskState
    capacity: int
    pickup: float
    place: float
    candidates: dict[Word, list[str]] = field(default_factory=dict)
    differ: list[tuple[Word, Word]] = field(default_factory=list)
    regions: dict[Word, list[str]] = field(default_factory=dict)
    limits: dict[str, int] = field(default_factory=dict)
    takes: dict[str, list[str]] = field(default_factory=dict)
    carriers: set[str] = field(default_factory=set)
    on: dict[str, str] = field(default_factory=dict)
    held: list[str] = field(default_factory=list)
    spots: dict[str, int] = field(default_factory=dict)
    fixed: set[str] = field(default_factory=set)
    sites: list[Endpoint] = field(default_factory=list)
    seconds: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 1)))
    finals: list[tuple[int, str]] = field(default_factory=list)
    operators: list[Operator] = field(default_factory=list)
    facts: list[tuple[str, ...]] = field(default_factory=list)
    slots: int = 0


def milliseconds(seconds: float) -> int:
    """Whole milliseconds, in which plans are compared."""
    return round(1000.0 * seconds)
