"""A route: what a robot does, step by step, to get from one place to another.

It is planned on the topology first, since each transition takes its own behaviour and its own map.
Each step has the poses that the robot's controller needs (Deeken et al., section 4.1).
"""

from __future__ import annotations

from dataclasses import dataclass

from planner.topology import PlaceConnector
from semmap.error import Error
from semmap.geometry.pose import Pose

BETWEEN_TRANSITIONS = ("navigate", "open_door", "unlock_door", "switch_map")
"""Behaviours that Figure 4 does not print."""


@dataclass(frozen=True)
class RouteStep:
    """One behaviour of the robot on its route.

    Attributes
    ----------
    behaviour
        navigate, open_door, unlock_door, call_elevator, use_elevator, switch_map, pass_door, or the
        behaviour of a connector.
    from_place, to_place
        Where the robot is before and after; equal if it stays.
    connector
        The connector that it passes, opens or waits at; None for other behaviours.
    elevator
        Name of the elevator that it calls or rides.
    approach
        Pose in the map's frame at which the step begins, facing the connector; None at the begin of
        a route whose start has no pose.
    leave
        Pose at which the step ends; after a passage, the robot faces away from the connector.
    seconds, metres
        Expected duration, and distance driven.
    bends
        Where the way through a connector bends, (x, y) in metres, since something stands in its
        opening.
    frame, map
        Frame of the grids to drive on, and path of the map file. The step ``switch_map`` has those
        of the new storey.
    """

    behaviour: str
    from_place: str
    to_place: str
    connector: PlaceConnector | None
    elevator: str | None
    approach: Pose | None
    leave: Pose
    seconds: float = 0.0
    metres: float = 0.0
    frame: str = "map"
    map: str = "map.yaml"
    bends: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Route:
    """The steps from one place to another, in order, with their expected seconds and metres."""

    start: str  # the name of a place
    goal: str
    steps: tuple[RouteStep, ...]  # all that the robot does, drives included
    seconds: float
    metres: float

    @property
    def transitions(self) -> tuple[RouteStep, ...]:
        """The steps that Figure 4 prints: no driving inside places, openings or map switches."""
        return tuple(s for s in self.steps if s.behaviour not in BETWEEN_TRANSITIONS)

    @property
    def doors(self) -> list[RouteStep]:
        """The passages: one step for each connector that the robot passes."""
        return [s for s in self.transitions if s.connector is not None and _passes(s, s.connector)]

    @property
    def begin(self) -> str:
        """Where it begins, in words: in the room of its goal, anywhere, so that it is 0 m long."""
        here = self.start == self.goal and self.steps and self.steps[0].approach is None
        return f"anywhere in {self.start}" if here else self.start

    def __repr__(self) -> str:
        way = f"{len(self.steps)} steps, {self.metres:.1f} m, {self.seconds:.0f} s"
        return f"<route from {self.begin} to {self.goal}: {way}>"


def _passes(step: RouteStep, connector: PlaceConnector) -> bool:
    """Whether a step passes its connector; a door inside one room does not change the place."""
    inside = connector.places[0] == connector.places[1]
    return step.from_place != step.to_place or (inside and step.behaviour == connector.behaviour)


class NoRouteError(Error, ValueError):
    """No route exists; the message says what blocks it."""
