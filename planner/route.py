"""A route: what a robot does to get from one place to another, step by step.

Planned on the topology first, since each transition takes its own behaviour and its own stretch of
map; each step is handed down with its poses (Deeken et al., section 4.1).
"""

from __future__ import annotations

from dataclasses import dataclass

from planner.topology import Connector
from semmap.geometry.pose import Pose

__all__ = ["NoRouteError", "Route", "Step"]

UNSAID = ("navigate", "open_door", "unlock_door", "switch_map")
"""Behaviours between the transitions that Figure 4 prints."""


@dataclass(frozen=True)
class Step:
    """One behaviour of the robot on its way.

    Attributes
    ----------
    behaviour
        navigate, open_door, unlock_door, call_elevator, use_elevator, switch_map, pass_door, or
        what the connector names
    from_place, to_place : where the robot is before and after; equal where it stays
    connector : what it passes, opens or stands before; None for the others
    elevator : the elevator that it calls or uses
    approach
        Pose in the map's frame at which the step begins, facing the connector; None where nobody
        said at which pose the route begins
    leave : pose at which it ends: for a passage, the pose behind the connector, turned away from it
    seconds, metres : how long it takes, and how far it drives
    frame, map : the frame of the grids it drives on, and the map file among those of its storey;
        a switch of maps has those of the new storey
    """

    behaviour: str
    from_place: str
    to_place: str
    connector: Connector | None
    elevator: str | None
    approach: Pose | None
    leave: Pose
    seconds: float = 0.0
    metres: float = 0.0
    frame: str = "map"
    map: str = "map.yaml"


@dataclass(frozen=True)
class Route:
    """What a robot does, in order; how long it takes, and the metres it drives.

    `stages` are all of it; `steps` the transitions alone, as Figure 4 prints them.
    """

    start: str
    goal: str
    stages: tuple[Step, ...]
    seconds: float
    metres: float

    @property
    def steps(self) -> tuple[Step, ...]:
        """The transitions, without walks, openings and switches of maps."""
        return tuple(s for s in self.stages if s.behaviour not in UNSAID)

    @property
    def doors(self) -> list[Step]:
        """The passages alone: one step for each connector passed."""
        return [s for s in self.steps if s.connector is not None and s.from_place != s.to_place]


class NoRouteError(ValueError):
    """No way leads there; the message says what bars it."""
