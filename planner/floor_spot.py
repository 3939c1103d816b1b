"""A free part of the floor, to put an object down where it is not in the way."""

from __future__ import annotations

import numpy as np
import shapely

from navgrid.inflation import INSCRIBED
from planner.base_pose import NoBasePoseError
from planner.entity_lookup import LocatedEntity
from planner.storey_costmaps import StoreyCostmaps
from semmap.geometry.pose import Pose

DOOR_CLEARANCE = 0.8
"""Metres from the passage of a connector that stay free."""

WAY_CLEARANCE = 0.5
"""Metres on both sides of the paths between connectors that stay free."""


def floor_spot(costmaps: StoreyCostmaps, place: str) -> LocatedEntity:
    """The free part of a floor that is nearest to the first door, off all doors and ways.

    Raises NoBasePoseError if there is none.
    """
    room, costs = costmaps.room(place), costmaps.costs(place)
    if room is None or costs is None:
        raise NoBasePoseError(f"the map has no outline of {place}")
    cells = np.argwhere(costs < INSCRIBED)
    points = np.array(room.grid.origin) + (cells[:, ::-1] + 0.5) * room.grid.resolution
    doors = costmaps.topology.connectors_of(place)
    poses = [connector.poses[side] for connector, side in doors]
    passages = [shapely.LineString([p[:2] for p in c.poses]) for c, _ in doors]
    paths = [costmaps.path(place, poses[0], pose) for pose in poses[1:]]
    ways = [shapely.LineString(path) for path in paths if path is not None]
    taken = shapely.union_all(
        [
            *(passage.buffer(DOOR_CLEARANCE) for passage in passages),
            *(way.buffer(WAY_CLEARANCE) for way in ways),
        ]
    )
    points = points[~shapely.contains_xy(taken, *points.T)]
    if not len(points):
        raise NoBasePoseError(
            f"{costmaps.robot.name} finds no free floor in {place} apart from its doors and ways"
        )
    start = np.array(poses[0][:2]) if poses else points.mean(axis=0)
    x, y = points[int(np.argmin(np.linalg.norm(points - start, axis=1)))]
    spot = Pose.planar(float(x), float(y), 0.0, costmaps.topology.places[place].floor)
    outline = shapely.Point(x, y).buffer(0.05)
    return LocatedEntity(f"the floor of {place}", "object", place, spot, outline)
