"""A mesh of a ramp is floor where it is gentle: in grids, routes and `check`, by arithmetic."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely

import semmap
from planner.route import NoRouteError
from semmap.geometry.mesh import Mesh

LONG = 4.0


@pytest.fixture
def db(database: str) -> Iterator[semmap.Database]:
    with semmap.connect(database) as found:
        yield found


def wedge(x: float, rise: float, low: float = 0.0, high: float = 2.0) -> Mesh:
    """A solid ramp from x on, from the ground to a rise."""
    corners = [
        (x + dx, y, z) for y in (low, high) for dx, z in ((0.0, 0.0), (LONG, 0.0), (LONG, rise))
    ]
    faces = [(0, 1, 2), (3, 5, 4), (0, 4, 1), (0, 3, 4), (1, 5, 2), (1, 4, 5), (0, 5, 3), (0, 2, 5)]
    return Mesh(np.array(corners), np.array(faces))


def is_routed(here: semmap.Map, *ends: object, robot: str | None = None) -> bool:
    try:
        here.route(*ends, robot=robot)  # type: ignore[arg-type]
    except NoRouteError:
        return False
    return True


@pytest.mark.parametrize("rise", [0.14, 0.3, 0.41, 0.43, 0.8])
@pytest.mark.parametrize("type_", ["ramp", "ramp_flight", "floor"])
def test_ramps_as_gentle_as_a_robot_climbs_are_floor(
    db: semmap.Database, type_: str, rise: float
) -> None:
    here = db.create_map("yard")
    here.add_room("yard", shapely.box(0, 0, 9, 9), floor=0)
    here.add_object("way", mesh=wedge(3, rise, 3, 6), pose=(0, 0, 0), type=type_)
    gentle = math.atan2(rise, LONG) <= math.radians(6)
    (grid,) = here.grids()
    column, row = (int((at - grid.grid.origin[k]) / 0.05) for k, at in enumerate((6, 4.5)))
    assert (grid.cells[row, column] == 0) == gentle
    assert is_routed(here, (1, 4.5, 0), (5.5, 4.5, 0)) == gentle


@pytest.mark.parametrize("rise", [0.1, 0.3, 0.4])
def test_doors_at_both_ends_of_a_ramp_are_open(
    db: semmap.Database, rise: float, tmp_path: Path
) -> None:
    here = db.create_map("corridor")
    for name, x, floor in (("low", 0, 0.0), ("middle", 4, 0.0), ("high", 8, rise)):
        outline = shapely.box(x, 0, x + 4, 2)
        here.add_room(name, outline, floor=floor, ceiling=3)
        if name != "middle":
            plate = (4, 2, 0.2 + floor)
            here.add_object(f"slab {name}", type="floor", size=plate, pose=(x + 2, 1, -0.2))
    here.add_object("way", mesh=wedge(4, rise), pose=(0, 0, 0), type="ramp")
    here.add_door("foot", "low", "middle", ((4, 0.2), (4, 1.8)))
    here.add_door("head", "middle", "high", ((8, 0.2), (8, 1.8)))
    assert here.check() == []
    urdf = tmp_path / "cart.urdf"
    urdf.write_text(
        '<robot name="cart"><link name="base"><collision><geometry>'
        '<box size="0.4 0.4 0.5"/></geometry></collision></link></robot>'
    )
    db.add_robot("cart", urdf)
    for robot in (None, "cart"):
        route = here.route("low", "high", robot=robot)
        assert route.places == ["low", "middle", "high"]
        assert is_routed(here, (1, 1, 0), (11, 1, rise), robot=robot)
    edges = (
        "SELECT count(*) FROM route_edge WHERE kind = 'passage' AND cost < 0 OR metres = 'Infinity'"
    )
    assert [*here.sql(edges)] == [(0,)]
    here["way"].delete()
    assert not is_routed(here, "low", "high", robot="cart")
    assert "step in a door" in {found.kind for found in here.check()}


def test_what_stands_on_a_ramp_before_a_door_is_in_its_way(db: semmap.Database) -> None:
    here = db.create_map("ramp")
    here.add_room("low", shapely.box(0, 0, 4, 2), floor=0, ceiling=3)
    here.add_room("long", shapely.box(4, 0, 10, 2), floor=0, ceiling=3)
    here.add_object("way", mesh=wedge(4, 0.3), pose=(0, 0, 0), type="ramp")
    here.add_door("gate", "low", "long", ((4, 0.2), (4, 1.8)))
    assert here.check() == []
    assert is_routed(here, "low", (7, 1, 0))
    here.add_object("crate", size=(0.3, 1.5, 0.5), pose=(4.15, 1, 0.01))
    assert not is_routed(here, "low", (7, 1, 0))
    assert ("thing in a doorway", ("gate", "crate")) in {
        (found.kind, found.entities) for found in here.check()
    }
