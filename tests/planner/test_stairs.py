"""Things on stairs: routes, SQL and `check` agree with a flood of cells."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy.ndimage import distance_transform_edt, label

import semmap
from planner.robot_class import BODY
from planner.route import NoRouteError

HALL, LOFT, RISE, LONG = "hall", "loft", 2.8, 5.0
CELL = 0.01

Box = tuple[float, float, float, float]
"""Metres: along the stairs from their foot, to the left of their middle, and the two sides."""


@pytest.fixture
def house(database: str) -> Iterator[semmap.Map]:
    """A hall, a loft above the end of it, and two flights of stairs that lead there."""
    with semmap.connect(database) as db:
        here = db.create_map("house")
        here.add_storey("low", elevation=0, height=RISE)
        here.add_storey("high", elevation=RISE, height=3)
        hall, loft = shapely.box(0, 0, 3, 8), shapely.box(2 + LONG, 0, 11, 8)
        here.add_room(HALL, hall, floor=0, ceiling=2.6, storey="low")
        here.add_room(LOFT, loft, floor=RISE, ceiling=RISE + 2.6, storey="high")
        yield here


def add_stairs(here: semmap.Map, name: str, y: float, width: float, form: str = "stairs") -> None:
    """Stairs from x = 2 on, to the loft."""
    middle = 2 + LONG / 2
    line = ((middle, y + width / 2), (middle, y - width / 2))
    here.add_door(name, HALL, LOFT, line, form=form, clearance=LONG / 2)  # type: ignore[arg-type]


def put(here: semmap.Map, name: str, y: float, box: Box, high: float = 0.4) -> None:
    """A box on the steps."""
    along, left, deep, wide = box
    steps = RISE * min(max(along / LONG, 0.0), 1.0)
    here.add_object(name, type="box", size=(deep, wide, high), pose=(2 + along, y + left, steps))


def widest(width: float, boxes: list[Box]) -> float:
    """The widest disc that gets over stairs, by a flood of cells: to three of them."""
    along, across = np.meshgrid(
        np.arange(CELL / 2, LONG, CELL), np.arange(-width / 2 + CELL / 2, width / 2, CELL)
    )
    free = np.ones(along.shape, bool)
    for x, y, deep, wide in boxes:
        free &= (abs(along - x) > deep / 2) | (abs(across - y) > wide / 2)
    padded = np.pad(free, ((1, 1), (0, 0)), constant_values=False)
    away = distance_transform_edt(padded)[1:-1] * CELL
    ends = round(0.3 / CELL)
    for reach in np.arange(away.max(), 0, -CELL / 2):
        parts = label(away >= reach, np.ones((3, 3)))[0]
        if np.intersect1d(parts[:, :ends], parts[:, -ends:]).any():
            return float(2 * reach)
    return 0.0


def is_routed(here: semmap.Map, start: str = HALL, goal: str = LOFT) -> bool:
    try:
        here.route(start, goal)
    except NoRouteError:
        return False
    return True


@pytest.mark.parametrize("seed", range(3))
def test_what_stands_on_stairs_narrows_them(house: semmap.Map, seed: int) -> None:
    draw = random.Random(seed)
    for number in range(8):
        name, width = f"flight{number}", round(draw.uniform(0.7, 1.6), 2)
        add_stairs(house, name, 4, width)
        boxes = []
        for k in range(draw.randint(0, 3)):
            side = draw.uniform(-width / 2, width / 2)
            box = (draw.uniform(0.8, LONG - 0.8), side, draw.uniform(0.1, 0.6), draw.uniform(0, 1))
            boxes.append(box)
            put(house, f"box{k} of {name}", 4, box)
        gap = widest(width, boxes)
        ((found,),) = house.sql(
            "SELECT clear_width(c) FROM connector c JOIN entity e ON e.id = c.entity_id "
            f"WHERE e.name = '{name}'"
        )
        met = [b for b in boxes if abs(b[1]) - b[3] / 2 < width / 2]
        assert (found is None) == (not met)
        assert found is None or abs(found - gap) < 4 * CELL or found == 0 > gap - 0.08
        if abs(gap - 0.6) > 4 * CELL:
            assert is_routed(house) == (gap > 0.6), (width, boxes, gap)
            told = [f for f in house.check() if f.kind == "thing on stairs"]
            assert [f.entities[0] for f in told] == ([] if gap > 0.6 else [name])
        for k in range(len(boxes)):
            house[f"box{k} of {name}"].delete()
        house[name].delete()


def test_a_route_leads_past_a_box_at_its_distance(house: semmap.Map) -> None:
    add_stairs(house, "flight", 4, 1.4)
    put(house, "box", 4, (2.5, -0.3, 0.5, 0.5))
    box = house["box"].footprint
    for ends in ((HALL, LOFT), (LOFT, HALL)):
        (step,) = (s for s in house.route(*ends).steps if s.behaviour == "climb_stairs")
        assert step.approach is not None
        way = shapely.LineString([step.approach[:2], *step.bends, step.leave[:2]])
        assert way.distance(box) == pytest.approx(BODY.footprint[:, 1].max(), abs=0.02)
        assert 3.59 < way.bounds[1] < way.bounds[3] < 4.41  # as far from the sides
        assert step.metres == pytest.approx(math.hypot(way.length, RISE), abs=1e-6)


def test_a_way_by_stairs_is_on_both_storeys_half_of_the_flight_on_each(house: semmap.Map) -> None:
    add_stairs(house, "flight", 4, 1.4)
    hall, loft = house[HALL].footprint, house[LOFT].footprint
    flight = shapely.box(2, 3.3, 2 + LONG, 4.7)
    for start, goal in ((HALL, LOFT), (LOFT, HALL)):
        route = house.route(start, goal)
        lines = {way["storey"]: np.array(way["points"]) for way in route.ways()}
        assert [*lines] == (["low", "high"] if start == HALL else ["high", "low"])
        for storey, floor, room in (("low", 0, hall), ("high", RISE, loft)):
            points = lines[storey]
            assert (points[:, 2] == floor).all()
            way = shapely.LineString(points[:, :2])
            assert way.difference(shapely.union(room, flight)).length < 1e-6
            assert way.intersection(flight.difference(room)).length <= LONG / 2 + 1e-6
        ends = (lines[storey] for storey in lines)
        before, after = (points[:, :2] for points in ends)
        np.testing.assert_allclose(before[-1], after[0], atol=1e-9)
        np.testing.assert_allclose(before[-1], (2 + LONG / 2, 4), atol=0.2)
        notes = route.plot().notes
    house.add_door("gate", HALL, None, ((0, 3), (0, 4)))
    for start, goal in (("outside", LOFT), (LOFT, "outside")):
        lines = {way["storey"]: way["points"] for way in house.route(start, goal).ways()}
        out = lines["low"][0 if start == "outside" else -1]
        assert {*lines} == {"low", "high"}
        assert out[0] < -0.2, "before the door"
        assert any("assumed" in note for note in notes)


def test_a_mission_and_the_topology_as_json_say_the_way_past_a_box(
    house: semmap.Map, tmp_path: Path
) -> None:
    add_stairs(house, "flight", 4, 1.4)
    put(house, "box", 4, (2.5, -0.3, 0.5, 0.5))
    assert house.run("in(robot, loft)", start=HALL, speed=1e5).done
    house.write_topology(tmp_path / "topology.json")
    (way,) = json.loads((tmp_path / "topology.json").read_text())["connectors"]
    assert way["narrowed"]["by"] == ["box"]
    assert way["narrowed"]["width"] == pytest.approx(0.75, abs=0.002)


def test_a_route_takes_the_other_stairs_until_the_wardrobe_is_gone(house: semmap.Map) -> None:
    add_stairs(house, "near", 2, 1.0)
    add_stairs(house, "far", 7, 1.0)
    start = (1, 1, 0)

    def taken() -> list[str]:
        return [s.connector.name for s in house.route(start, (10, 1, RISE)).doors]

    assert taken() == ["near"]
    house.add_object("wardrobe", type="wardrobe", size=(0.5, 1.2, 2.3), pose=(4, 2, 0))
    assert taken() == ["far"]
    put(house, "crate", 7, (2.0, 0.0, 0.5, 0.6))
    with pytest.raises(NoRouteError, match=r"wardrobe leaves no way over near; robot is 0.60 m"):
        house.route(start, (10, 1, RISE))
    found = {f.entities: f for f in house.check() if f.kind == "thing on stairs"}
    assert {*found} == {("near", "wardrobe"), ("far", "crate")}
    assert "no robot passes" in found["near", "wardrobe"].text
    assert "move it off the way" in found["near", "wardrobe"].fix
    with pytest.raises(ValueError, match=r"crate leaves 0\.20 m of far free"):
        house.plan("in(robot, loft)", start=HALL)
    house["wardrobe"].move_to(1, 7, 0)
    assert taken() == ["near"]
    assert [f.entities for f in house.check() if f.kind == "thing on stairs"] == [("far", "crate")]


@pytest.mark.parametrize(
    ("size", "low", "type_"),
    [
        ((1.0, 1.0, 0.9), 0.0, "cupboard"),  # under the stairs
        ((0.3, 0.3, 0.3), 3.6, "lamp"),  # above heads
        ((0.8, 1.0, 0.03), 1.4, "carpet"),
        ((1.0, 1.0, 2.0), 0.0, "wall"),
        ((LONG, 1.0, RISE), 0.0, None),  # the stairs themselves
    ],
    ids=["cupboard", "lamp", "carpet", "wall", "flight"],
)
def test_what_is_not_on_the_steps_leaves_them_free(
    house: semmap.Map, size: tuple[float, float, float], low: float, type_: str | None
) -> None:
    add_stairs(house, "flight", 4, 1.0)
    x = 2 + LONG / 2 + (1.0 if type_ == "cupboard" else 0.0)
    house.add_object("thing", type=type_, size=size, pose=(x, 4, low))
    assert is_routed(house)
    assert not [f for f in house.check() if f.kind == "thing on stairs"]


def test_a_robot_with_a_shape_meets_things_on_ramps_in_python_and_sql(
    house: semmap.Map, tmp_path: Path
) -> None:
    add_stairs(house, "ramp", 4, 1.2, "ramp")
    put(house, "pallet", 4, (2.5, 0.3, 0.6, 0.6))
    edges = (
        "SELECT cost < 0 FROM route_edge x JOIN map m ON m.id = x.map_id WHERE m.name = 'house' "
        "AND kind = 'passage' AND robot_class = '{}'"
    )
    for name, width, passes in (("slim", 0.5, True), ("wide", 0.7, False)):
        urdf = tmp_path / f"{name}.urdf"
        urdf.write_text(
            f'<robot name="{name}"><link name="base"><collision><geometry>'
            f'<box size="0.4 {width} 0.5"/></geometry></collision></link></robot>'
        )
        house.database.add_robot(name, urdf, max_slope=40)
        assert [*house.sql(edges.format(name))] == [(not passes,)]
        if passes:
            assert house.route(HALL, LOFT, robot=name).places == [HALL, LOFT]
        else:
            with pytest.raises(NoRouteError, match=r"pallet leaves 0.60 m of ramp free; wide is"):
                house.route(HALL, LOFT, robot=name)
