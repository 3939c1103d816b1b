"""A building of rooms along corridors, as a topology: floors, corridors, an elevator."""

from __future__ import annotations

import math

from planner.topology import Place, PlaceConnector, Topology
from semmap.geometry.pose import Pose

__all__ = ["rooms"]

PITCH, DEPTH, STOREY = 4.0, 6.0, 3.2  # metres: a room's width and depth, and from floor to floor


def rooms(floors: int = 10, corridors: int = 5, along: int = 19) -> Topology:
    """Floors of corridors with rooms on one side, joined end to end, and an elevator in the first.

    A floor has ``corridors * (along + 1)`` rooms, corridors among them, and a cabin.
    """
    places, connectors = [], []
    for f in range(floors):
        z, storey = f * STOREY, f"floor-{f}"
        lift = f"lift-{f}"
        places.append(Place(lift, storey=storey, elevator="lift", floor=z))
        for c in range(corridors):
            y = c * (DEPTH + 3.0)
            hall = f"corridor-{f}-{c}"
            places.append(Place(hall, storey=storey, floor=z))
            for r in range(along):
                x = (r + 0.5) * PITCH
                places.append(Place(f"room-{f}-{c}-{r}", storey=storey, floor=z))
                connectors.append(_door(f"door-{f}-{c}-{r}", hall, places[-1].name, x, y, z, 1))
            if c:
                connectors.append(
                    _door(f"pass-{f}-{c}", f"corridor-{f}-{c - 1}", hall, -1.0, y - 2.0, z, 1)
                )
        connectors.append(_door(f"edoor-{f}", f"corridor-{f}-0", lift, 0.0, -1.5, z, -1))
    return Topology.of(places, connectors)


def _door(name: str, a: str, b: str, x: float, y: float, z: float, north: int) -> PlaceConnector:
    """A door at (x, y) that leads north or south from a to b."""
    heading = math.copysign(math.pi / 2, north)
    poses = (
        Pose.planar(x, y - 0.6 * north, heading, z),
        Pose.planar(x, y + 0.6 * north, -heading, z),
    )
    return PlaceConnector(name, (a, b), poses, width=0.9)
