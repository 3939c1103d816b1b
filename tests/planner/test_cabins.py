"""Rides in a lift whose doors are on two sides: the robot crosses the cabin, or cannot."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import shapely
from shapely.geometry import mapping

import semmap
from planner.route import NoRouteError
from planner.tasks import NoPlanError
from semmap import Map
from tests.conftest import MakeDatabase

CABIN = shapely.box(3.1, 1, 5.3, 4)
WEST, NORTH = shapely.Point(3.1, 1.7), shapely.Point(4.6, 4)
SLIM, WIDE = 0.15, 0.45  # radii below and above that of the robot without a class, metres


@pytest.fixture
def tower(make_database: MakeDatabase, tmp_path: Path):
    """Two storeys with a lift that is entered from the west below and left to the north above."""
    found = []

    def add(shape: shapely.Geometry | None, **properties: object) -> None:
        geometry = None if shape is None else mapping(shape)
        found.append({"type": "Feature", "properties": properties, "geometry": geometry})

    add(None, kind="elevator", name="hoist")
    for i, z in enumerate((0.0, 3.5)):
        level = {"storey": f"level{i}"}
        add(None, kind="storey", name=f"level{i}", elevation=z, height=3.2)
        rooms = {"west": shapely.box(0, 0, 3, 5), "north": shapely.box(3.1, 4.1, 7, 8)}
        for name, outline in rooms.items():
            add(outline, kind="room", name=f"{name}{i}", floor=0, ceiling=3, **level)
        add(CABIN, kind="room", name=f"cabin{i}", floor=0, ceiling=2.4, elevator="hoist", **level)
        lines = {"west": [(3.05, 1.2), (3.05, 2.2)], "north": [(4.1, 4.05), (5.1, 4.05)]}
        for name, line in lines.items():
            joins = {"joins": f"{name}{i},cabin{i}", "type": "elevator_door"}
            add(shapely.LineString(line), kind="connector", name=f"to_{name}{i}", **joins, **level)
    path = tmp_path / "tower.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": found}))
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        made = db.create_map("tower")
        made.import_file(path, define=True)
        yield made


def crosses(crate: shapely.Geometry, radius: float) -> bool:
    """Whether a disc gets from one door to the other on the floor of the cabin: by Shapely."""
    walls = shapely.difference(CABIN.exterior, shapely.union(WEST.buffer(0.5), NORTH.buffer(0.5)))
    free = shapely.difference(CABIN, shapely.union(crate, walls).buffer(radius))
    parts = shapely.get_parts(free)
    return any(part.distance(WEST) < 0.4 and part.distance(NORTH) < 0.4 for part in parts)


@pytest.mark.parametrize(
    ("x0", "y0", "x1", "y1"),
    [
        (3.12, 2.6, 5.28, 2.9),  # from wall to wall
        (3.12, 2.6, 3.9, 2.9),  # a way of 1.4 m is left
        (4.9, 1.1, 5.2, 1.6),  # in a corner
        (3.12, 2.5, 5.1, 2.8),  # a gap of 0.2 m is left
        (4.1, 1.05, 4.3, 3.95),  # along the cabin
    ],
)
@pytest.mark.parametrize("storey", [0, 1])
def test_a_ride_crosses_the_cabin_on_its_free_floor(
    tower: Map, storey: int, x0: float, y0: float, x1: float, y1: float
) -> None:
    crate = shapely.box(x0, y0, x1, y1)
    passes = crosses(crate, SLIM)
    assert passes == crosses(crate, WIDE)
    x, y = crate.centroid.coords[0]
    size = (x1 - x0, y1 - y0, 0.8)
    assert tower.route("west0", "north1").steps
    tower.add_object("crate", type="crate", size=size, pose=(x, y, 3.5 * storey, 0), define=True)
    there = [("west0", "north1"), ("north0", "west1"), ("north1", "west0")]
    for start, goal in there:
        if passes:
            rides = [step.elevator for step in tower.route(start, goal).steps if step.elevator]
            assert "hoist" in rides
            assert tower.plan(f"in(robot, {goal})", start=start).actions
        else:
            why = f"robot finds no path in cabin{storey} from to_{start} to to_{goal}"
            with pytest.raises(NoRouteError, match=why):
                tower.route(start, goal)
            with pytest.raises(NoPlanError, match=why):
                tower.plan(f"in(robot, {goal})", start=start)
    for side in ("west", "north"):  # to the same door, nothing is crossed
        assert tower.route(f"{side}0", f"{side}1").steps
    tower["crate"].delete()
    assert tower.route("west0", "north1").steps


@pytest.mark.parametrize(("gap", "rides"), [(0.15, False), (0.2, False), (1.0, True), (1.4, True)])
def test_the_doors_close_behind_a_robot(tower: Map, gap: float, rides: bool) -> None:
    """It stands wholly between the door and a crate: not in the doorway, as where none closes."""
    assert rides == (gap > 2 * WIDE)
    assert rides != (gap < 2 * SLIM)
    x0, x1 = CABIN.bounds[0] + gap, 5.28
    size, middle = (x1 - x0, 2.9, 0.8), ((x0 + x1) / 2, 2.5, 0, 0)
    tower.add_object("crate", type="crate", size=size, pose=middle, define=True)
    if rides:
        assert tower.route("west0", "west1").steps
        assert tower.plan("in(robot, west1)", start="west0").actions
    else:
        with pytest.raises(NoRouteError, match="crate leaves robot no way through to_west0"):
            tower.route("west0", "west1")
        with pytest.raises(NoPlanError, match="crate leaves robot no way through to_west0"):
            tower.plan("in(robot, west1)", start="west0")


def test_a_square_robot_does_not_ride_in_less_than_its_width(tower: Map, tmp_path: Path) -> None:
    """Its middle is passable in the doorway, where half of it would be in the door."""
    urdf = tmp_path / "square.urdf"
    urdf.write_text(
        '<robot name="square"><link name="base_link"><collision><origin xyz="0 0 0.2"/>'
        '<geometry><box size="0.6 0.6 0.4"/></geometry></collision></link></robot>'
    )
    tower.database.add_robot("square", urdf)
    for gap, rides in ((0.55, False), (0.75, True)):
        x0, x1 = CABIN.bounds[0] + gap, 5.28
        size, middle = (x1 - x0, 2.9, 0.8), ((x0 + x1) / 2, 2.5, 0, 0)
        tower.add_object("crate", type="crate", size=size, pose=middle, define=True)
        if rides:
            assert tower.route("west0", "west1", robot="square").steps
        else:
            with pytest.raises(NoRouteError, match="crate leaves square no way"):
                tower.route("west0", "west1", robot="square")
        tower["crate"].delete()
