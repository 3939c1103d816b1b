"""What of a world a goal can use: the facts that the logic program and PDDL are grounded on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planner.network import Site
from planner.tasks.goal import Goal, Word
from planner.tasks.world import State

__all__ = ["NoPlanError", "Operator", "Problem", "milliseconds"]


class NoPlanError(ValueError):
    """No plan reaches the goal; the message says what bars it."""


@dataclass(frozen=True)
class Operator:
    """An action of a domain file with things in place of its parameters.

    Facts are tuples of a predicate and names.
    """

    name: str
    arguments: tuple[str, ...]
    seconds: float
    at: str | None
    held: tuple[str, ...] = ()
    on: tuple[tuple[str, str], ...] = ()
    asks: tuple[tuple[str, ...], ...] = ()
    asks_not: tuple[tuple[str, ...], ...] = ()
    adds: tuple[tuple[str, ...], ...] = ()
    deletes: tuple[tuple[str, ...], ...] = ()


@dataclass
class Problem:
    """A goal over the part of a world that it can use.

    Attributes
    ----------
    goal, state, capacity : as they were given
    pickup, place : seconds
    candidates : what each word of the goal for a thing may mean
    differ : pairs of words that mean different things
    regions : what each word for a place may mean
    limits : how often each movable thing is picked up at most
    takes : which movable things may be put on each thing (or on a place's floor)
    carriers : those of them that are carried with what stands on them
    on : what each of them is on at first; held: those that the robot carries
    spots : of each of them and of what takes them, the number of the site where one stands
    fixed : those that never move
    sites : the first is the robot's own
    seconds : (n, n) float64 between sites; inf where no way leads
    finals : sites at which the robot may end, with the place that is then reached
    slots : no plan needs more events
    """

    goal: Goal
    state: State
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
    sites: list[Site] = field(default_factory=list)
    seconds: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 1)))
    finals: list[tuple[int, str]] = field(default_factory=list)
    operators: list[Operator] = field(default_factory=list)
    facts: list[tuple[str, ...]] = field(default_factory=list)
    slots: int = 0


def milliseconds(seconds: float) -> int:
    """Whole milliseconds, in which plans are compared."""
    return round(1000.0 * seconds)
