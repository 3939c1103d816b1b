"""From a detection to the entity, the costmap and the plan; Shapely and trimesh judge the poses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import psycopg
import pytest
import shapely
from scipy.ndimage import distance_transform_edt
from sqlalchemy import Engine

import semmap
from planner.search.reader import read_doubtful
from semmap import Map
from semmap.belief.identify import Detection

KITCHEN, COFFEE = "KitchenTable_01_001", "CoffeeTable_01_001"


@pytest.fixture(scope="module")
def world_map(house: Engine) -> Iterator[Map]:
    with semmap.connect(house.url.render_as_string(hide_password=False)) as db:
        yield db.map("house")


@pytest.fixture
def here(world_map: Map) -> Iterator[Map]:
    """The small house with a plate on the kitchen table; what a test changes is undone."""
    with world_map.transaction() as transaction:
        world_map.add_object("plate", type="plate", size=(0.2, 0.2, 0.03), on=KITCHEN)
        yield world_map
        raise psycopg.Rollback(transaction)


def top(map_: Map, table: str) -> tuple[float, float, float]:
    """The middle of a table, at the height of its highest face there."""
    mesh = map_[table].mesh
    x, y = mesh.bounds.mean(axis=0)[:2]
    hits, _, _ = mesh.ray.intersects_location([[x, y, 5.0]], [[0, 0, -1.0]])
    return float(x), float(y), float(hits[:, 2].max())


def test_an_object_that_is_surely_seen_elsewhere_is_there(here: Map) -> None:
    x, y, z = top(here, COFFEE)
    spot = (x + 0.1, y - 0.05, z + 0.015)
    assert here["plate"].holder != COFFEE
    here.observe_point("plate", spot)
    plate = here["plate"]
    assert str(plate.holder.name) == COFFEE
    low, high = plate.mesh.bounds
    np.testing.assert_allclose((low + high)[:2] / 2, spot[:2], atol=1e-6)
    assert low[2] == pytest.approx(z, abs=0.01)
    assert plate.footprint.symmetric_difference(shapely.box(*low[:2], *high[:2])).area < 1e-9
    assert here.where("plate")[COFFEE] > 0.95


def test_a_doubtful_sighting_moves_nothing(here: Map) -> None:
    before = here["plate"].pose
    x, y, z = top(here, COFFEE)
    here.observe_point("plate", (x, y, z + 0.02), hit=0.7, false_alarm=0.2)
    assert here["plate"].pose == before
    assert 0.001 < here.where("plate")[COFFEE] < 0.5


def test_a_plan_looks_first_where_belief_and_map_disagree(here: Map) -> None:
    """A place without a point says nothing of the pose; one that agrees leaves no doubt."""
    with here.snapshot() as seen:
        assert not read_doubtful(seen, ["plate"])
    here.observe("plate", KITCHEN)
    with here.snapshot() as seen:
        assert not read_doubtful(seen, ["plate"])
    here.observe("plate", COFFEE)
    assert here.where("plate").best == COFFEE
    assert here["plate"].holder.name == KITCHEN
    with here.snapshot() as seen:
        assert read_doubtful(seen, ["plate"])


def test_what_is_looked_for_in_vain_has_no_place_in_the_end(here: Map) -> None:
    shares = []
    for _ in range(8):
        if here["plate"].pose is None:
            break
        shares.append(here.where("plate")[KITCHEN])
        here.observe("plate", KITCHEN, seen=False)
    assert shares == sorted(shares, reverse=True)
    assert 3 <= len(shares) < 8
    assert here["plate"].pose is None
    x, y, z = top(here, COFFEE)
    here.observe_point("plate", (x, y, z + 0.02))
    assert str(here["plate"].holder.name) == COFFEE


def test_grid_and_plan_follow_a_sighting(world_map: Map) -> None:
    """Of a box on the floor: its cells are free where it was, and taken where it is."""
    here = world_map
    grid = here.grid()
    free = distance_transform_edt(grid.cells == 0) * grid.grid.resolution
    roomy = np.argwhere(free > 1.0)  # the robot of a plan passes beside the box
    (row, column), (row2, column2) = roomy[0], roomy[-1]
    corner = np.array(grid.grid.origin[:2])

    def middle(row: int, column: int) -> np.ndarray:
        return corner + (np.array((column, row)) + 0.5) * grid.grid.resolution

    first, second = middle(row, column), middle(row2, column2)
    here.add_object("crate", type="cardboard_box", size=(0.4, 0.08, 0.4), pose=(*first, 0))
    assert here.grid().cells[row, column] == 100
    at = here["crate"].room
    here.observe_point("crate", (*second, 0.2))
    low, high = here["crate"].mesh.bounds
    np.testing.assert_allclose((low + high)[:2] / 2, second, atol=1e-6)
    assert low[2] == pytest.approx(0.0, abs=0.02)
    after = here.grid().cells
    assert after[row, column] == 0
    assert after[row2, column2] == 100
    changed = {tuple(cell) for cell in np.argwhere(after != grid.cells)}
    box = shapely.box(*low[:2], *high[:2]).buffer(grid.grid.resolution)
    assert changed
    assert all(box.covers(shapely.Point(middle(*cell))) for cell in changed)
    assert here["crate"].room != at, "the first and the last free cell are in different rooms"
    try:
        plan = str(here.plan("on(crate, KitchenTable_01_001)", start="kitchen").actions)
        assert here["crate"].room.name in plan
        assert at.name not in plan
    finally:
        here["crate"].delete()


def test_detections_are_known_objects_or_become_new_ones(here: Map) -> None:
    x, y, z = top(here, KITCHEN)
    plate = here["plate"].mesh.bounds.mean(axis=0)
    u, v, w = top(here, COFFEE)
    sides = (0.2, 0.2, 0.03)
    seen = here.observe_objects(
        [
            Detection("plate", (plate[0] + 0.02, plate[1], plate[2]), sides),
            Detection("plate", (u, v, w + 0.015), sides),
            Detection("apple", (u + 0.1, v, w + 0.04), (0.08, 0.08, 0.08)),
            Detection("banana", (x, y, z + 0.02)),
        ]
    )
    names = [row["object"] for row in seen]
    assert names == ["plate", "plate_1", "apple_1", "banana_1"]
    assert [row["new"] for row in seen] == [False, True, True, True]
    assert [row["place"] for row in seen] == [KITCHEN, COFFEE, COFFEE, KITCHEN]
    np.testing.assert_allclose(
        here["plate"].mesh.bounds.mean(axis=0)[:2], plate[:2] + np.array((0.02, 0)), atol=1e-6
    )
    for name, point in (("plate_1", (u, v)), ("apple_1", (u + 0.1, v))):
        low, high = here[name].mesh.bounds
        np.testing.assert_allclose((low + high)[:2] / 2, point, atol=1e-6)
        assert low[2] == pytest.approx(w, abs=0.01)
        assert here[name].holder.name == COFFEE
    again = here.observe_objects([Detection("apple", (u + 0.1, v, w + 0.04), (0.08, 0.08, 0.08))])
    assert [(row["object"], row["new"]) for row in again] == [("apple_1", False)]
    assert again[0]["probability"] > 0.9


def test_a_doubtful_detection_tells_how_sure_it_is(here: Map) -> None:
    """Of two plates of one size, one was put somewhere in the house: a plate is seen elsewhere."""
    here.add_object("other", type="plate", size=(0.2, 0.2, 0.03))
    u, v, w = top(here, COFFEE)
    before = here["plate"].pose
    seen = Detection("plate", (u, v, w + 0.015), (0.2, 0.2, 0.03))
    (row,) = here.observe_objects([seen], new=0.01)
    assert not row["new"]
    assert row["object"] == "other"
    assert sum(row["may_be"].values()) == pytest.approx(1)
    assert row["may_be"]["other"] == row["probability"] < 0.9
    assert here["plate"].pose == before
    assert here["other"].pose is None
    assert here.where("other")[COFFEE] == pytest.approx(row["probability"], abs=0.02)
    assert here.where("plate")[COFFEE] == pytest.approx(row["may_be"]["plate"], abs=0.02)


def test_what_is_probably_new_is_not_given_to_an_unlikely_known_object(here: Map) -> None:
    """The plate was just seen on the kitchen table: the one that is seen elsewhere is hardly it."""
    x, y, z = here["plate"].mesh.bounds.mean(axis=0)
    here.observe_point("plate", (x, y, z))
    u, v, w = top(here, COFFEE)
    seen = Detection("plate", (u, v, w + 0.015), (0.2, 0.2, 0.03))
    before, names = here["plate"].pose, {each.name for each in here.find("plate")}
    for _ in range(5):
        (doubtful,) = here.observe_objects([seen], new=0.002, false_alarm=0.001)
        assert doubtful["object"] is None
        assert 0.5 < doubtful["may_be"]["(new)"] < 0.9
        assert not doubtful["new"]
    assert {each.name for each in here.find("plate")} == names
    assert here["plate"].pose == before
    assert here.where("plate")[KITCHEN] > 0.8
    (sure,) = here.observe_objects([seen], new=0.2)
    assert sure["new"]
    assert sure["object"] == "plate_1"
    assert here["plate"].pose == before


def test_a_wrong_detection_changes_nothing(here: Map) -> None:
    good = Detection("apple", (*top(here, COFFEE)[:2], top(here, COFFEE)[2] + 0.04))
    for wrong in (Detection("appel", good.point), Detection("plate", (5000.0, 0.0, 0.0))):
        with pytest.raises((ValueError, LookupError)), here.transaction():
            here.observe_objects([good, wrong])
        assert "apple_1" not in [each.name for each in here.find("object", limit=500)]


def test_a_plate_beside_an_l_shaped_cabinet_is_not_on_it(here: Map) -> None:
    """In the open corner of the L, which Shapely finds: on the floor, and in the air."""
    cabinet = here["KitchenCabinet_01_001"]
    flat = shapely.polygons(cabinet.mesh.triangles[:, :, :2])
    covered = shapely.union_all(flat[shapely.area(flat) > 1e-9])
    assert cabinet.footprint.symmetric_difference(covered).area < 0.01 * covered.area
    corner = max(
        shapely.get_parts(covered.convex_hull - covered), key=lambda part: float(part.area)
    )
    circle = shapely.maximum_inscribed_circle(corner.buffer(-0.3))
    spot = shapely.Point(circle.coords[0])
    assert spot.distance(covered) > 0.3
    assert covered.convex_hull.contains(spot)

    here.observe_point("plate", (spot.x, spot.y, 0.015))
    assert str(here["plate"].holder.name) == "kitchen"
    assert here.where("plate").get(cabinet.name, 0.0) < 0.05
    counter = float(cabinet.mesh.bounds[0, 2]) + 0.9
    with pytest.raises(ValueError, match="where nothing carries it"):
        here.observe_point("plate", (spot.x, spot.y, counter))
    here["plate"].move_to(spot.x, spot.y, 0.0)
    assert str(here["plate"].holder.name) == "kitchen"
    assert not here.sql("SELECT is_on(entity_id('plate'), entity_id('KitchenCabinet_01_001'))")[0][
        0
    ]
