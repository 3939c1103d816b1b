"""A plan stands where routes lead: another base pose is taken, if the best one is shut off."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import shapely

import semmap
from semmap import Map
from tests.conftest import MakeDatabase

ISLE, COAST, SHED = (shapely.box(*b) for b in [(0, 0, 6, 4), (6.2, 0, 9, 4), (-3, 0, -0.2, 4)])
COUNTER = shapely.box(3.8, 0, 4.5, 4)
"""From wall to wall: in front is a strip of 1.5 m with the door, behind it is most of the room."""


@pytest.fixture(scope="module")
def port(make_database: MakeDatabase) -> Iterator[Map]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        port = db.create_map("port")
        for name, outline in (("isle", ISLE), ("coast", COAST), ("shed", SHED)):
            port.add_room(name, outline, floor=0, ceiling=2.7)
        port.add_door("gate", "isle", "coast", [(6.1, 1), (6.1, 2)])
        port.add_door("hatch", "isle", "shed", [(-0.1, 1), (-0.1, 2)])
        x0, y0, x1, y1 = COUNTER.bounds
        middle = COUNTER.centroid
        size = (x1 - x0, y1 - y0, 0.8)
        port.add_object("bar", type="counter", size=size, pose=(middle.x, middle.y, 0))
        port.add_object("jug", type="mug", size=(0.08, 0.08, 0.1), pose=(4.1, 2, 0.8))
        port.add_object("spoon", type="spoon", size=(0.1, 0.05, 0.02), pose=(8.5, 3.5, 0.5))
        port.add_object("lamp", type="mug", size=(0.08, 0.08, 0.6), pose=(1, 2, 0))
        port.add_object("stool", type="table", size=(0.4, 0.4, 0.5), pose=(8.5, 3.5, 0))
        yield port


@pytest.mark.parametrize("goal", ["carries(robot, jug)", "on(jug, stool)", "on(spoon, bar)"])
def test_a_plan_stands_where_routes_lead(port: Map, goal: str) -> None:
    """Clear ones are best, and behind the bar there is more room; but no route leads there."""
    plan = port.plan(goal, start="coast")
    stands = [a.at for a in plan.actions if a.at is not None and a.at.x < ISLE.bounds[2]]
    assert stands
    assert all(at.x > COUNTER.bounds[2] for at in stands)


@pytest.mark.parametrize(("there", "east"), [("coast", True), ("shed", False)])
def test_a_robot_in_a_divided_room_is_in_the_part_with_a_way_on(
    port: Map, there: str, east: bool
) -> None:
    """The robot may be on both sides of the bar; the way on decides from which it takes the jug."""
    plan = port.plan(f"in(jug, {there})", start="isle")
    (stand,) = (a.at for a in plan.actions if a.name == "pickup")
    assert stand is not None
    assert (stand.x > COUNTER.bounds[2]) == east


def test_what_no_route_leads_to_is_refused(port: Map) -> None:
    with pytest.raises(ValueError, match="lamp cannot be reached"):
        port.plan("carries(robot, lamp)", start="coast")
