"""A plan: actions in order, as the paper prints them (Deeken et al., Figure 4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from planner.route import Step
from semmap.geometry.pose import Pose

__all__ = ["Action", "Plan"]


@dataclass(frozen=True)
class Action:
    """One action of a plan.

    Attributes
    ----------
    name : pass_door, call_elevator, use_elevator, open_door, pickup, place, or one of a domain file
    arguments : names, as the paper has them: ``pass_door(door1, lab1, corridor1)``
    seconds : how long it takes, the way to where it begins among it
    steps : what the robot does for it, in order: a walk, and then the transition
    at : of pickup and place: where the base stands, in the map's frame
    entities : the entities' own names where `arguments` has what the goal called them: muffin1 for
        ``muffin``; empty where both are the same
    """

    name: str
    arguments: tuple[str, ...]
    seconds: float = 0.0
    steps: tuple[Step, ...] = ()
    at: Pose | None = None
    entities: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The entities' own names, one for each argument."""
        return self.entities or self.arguments

    def __str__(self) -> str:
        return f"{self.name}({', '.join(self.arguments)})" if self.arguments else self.name


@dataclass(frozen=True)
class Plan:
    """Actions in order, which reach a goal.

    Attributes
    ----------
    goal : as it was said
    seconds : how long all of it takes
    bound : no plan takes less, seconds; where it equals `seconds` the plan is optimal
    """

    goal: str
    actions: tuple[Action, ...]
    seconds: float
    bound: float

    @property
    def gap(self) -> float:
        """By which part of the bound the plan may be longer than the shortest, at most."""
        if self.optimal:
            return 0.0
        return (self.seconds - self.bound) / self.bound if self.bound > 0 else math.inf

    @property
    def optimal(self) -> bool:
        """Whether no plan is shorter, within a millisecond."""
        return self.seconds <= self.bound + 1e-3
