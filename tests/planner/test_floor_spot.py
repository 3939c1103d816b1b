"""Objects on a floor leave its doors, and the ways between them, free."""

from __future__ import annotations

import pytest
import shapely

from planner.base_pose import DOOR_CLEARANCE, WAY_CLEARANCE, NoBasePoseError, floor_spot
from tests.planner.test_storey_costmaps import box, ground


def test_a_spot_is_free_and_off_doors_and_ways() -> None:
    crate = box(10, 0.6, 0.6, 0.3, name="crate")
    made = ground([crate])
    spot = floor_spot(made, "left")
    assert spot.pose is not None
    point = shapely.Point(spot.pose.x, spot.pose.y)
    assert shapely.box(0, 0, 3, 3).contains(point)
    assert point.distance(shapely.box(0.3, 0.3, 0.9, 0.9)) > 0.2
    (door, side), (hatch, _) = made.topology.connectors_of("left")
    for connector in (door, hatch):
        passage = shapely.LineString([p[:2] for p in connector.poses])
        assert passage.distance(point) > DOOR_CLEARANCE - 0.05
    # without the crate in the way, the shortest way is the straight line
    way = shapely.LineString([p[:2] for p in (door.poses[side], hatch.poses[0])])
    assert way.distance(point) > WAY_CLEARANCE - 0.1


def test_a_full_floor_is_refused() -> None:
    things = [box(10, 1.5, 0.0, 1.3), box(11, 2.1, 2.8, 0.7), box(12, 0.1, 1.4, 0.4)]
    with pytest.raises(NoBasePoseError, match="no free floor in left apart from its doors"):
        floor_spot(ground(things), "left")
