"""The office read from the database, whole, in part, at a time, and as it changes."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import shapely
from sqlalchemy import Connection, Engine, text

from navgrid.costmap import Costmap
from navgrid.scene import Thing, grid_of
from navgrid.source import read_scene, read_storey_names, read_things
from semmap.ingest.importer import import_file
from semmap.ingest.regions.extraction import draw_region
from semmap.query.change_feed import changed_since, cursor
from tests.navgrid.scenes import ARM, BASE

OFFICE = Path(__file__).parents[2] / "examples" / "office"


@pytest.fixture(scope="module")
def office(module_engine: Engine) -> Engine:
    """A database that holds the office."""
    for name in ("office_rooms.geojson", "office.sdf"):
        import_file(module_engine, OFFICE / name, map_name="office")
    return module_engine


@pytest.fixture
def connection(office: Engine) -> Iterator[Connection]:
    with office.connect() as connection:
        yield connection
        connection.rollback()


def by_name(things: tuple[Thing, ...]) -> dict[str, Thing]:
    return {t.name: t for t in things}


def test_a_storey_has_what_reaches_into_it(connection: Connection) -> None:
    assert read_storey_names(connection) == ["floor-1st", "floor-3rd"]
    first, third = (read_scene(connection, name) for name in ("floor-1st", "floor-3rd"))
    assert (first.elevation, third.elevation) == (0.0, 7.0)
    assert {"desk4", "walls-3rd", "door6"} <= set(by_name(third.things))
    assert not {"desk4", "door6", "office4"} & set(by_name(first.things))
    assert {p.name for p in third.places} >= {"office4", "lab2", "door6"}
    assert {p.floor for p in third.places} == {7.0}
    stairs = by_name(first.things)["staircase"]
    assert stairs.outline is not None
    hole = shapely.box(0, 1.8, 1.2, 4.6)
    assert stairs.outline.symmetric_difference(hole).area < 1e-9


def test_triangles_are_those_in_the_world(connection: Connection) -> None:
    desk = by_name(read_scene(connection, "floor-3rd").things)["desk4"]
    low, high = connection.execute(
        text("SELECT ARRAY[ST_XMin(box), ST_YMin(box), ST_ZMin(box)], "
             "ARRAY[ST_XMax(box), ST_YMax(box), ST_ZMax(box)] FROM world "
             "WHERE entity_id = entity_id('desk4')")
    ).one()  # fmt: skip
    flat = desk.triangles.reshape(-1, 3)
    np.testing.assert_allclose(flat.min(0), low, atol=1e-6)
    np.testing.assert_allclose(flat.max(0), high, atol=1e-6)
    assert desk.types[:3] == ("desk", "table", "furniture") or desk.types[0] == "desk"


def test_a_shut_door_without_a_leaf_is_its_opening(connection: Connection) -> None:
    connection.execute(
        text("UPDATE connector SET state = 'closed' WHERE entity_id = entity_id('door6')")
    )
    door = by_name(read_scene(connection, "floor-3rd").things)["door6"]
    assert door.state == "closed"
    flat = door.triangles.reshape(-1, 3)
    np.testing.assert_allclose(np.ptp(flat, axis=0), [0.9, 0.05, 2.1], atol=1e-9)
    np.testing.assert_allclose(flat.mean(0)[:2], [5.7, 4.1], atol=0.05)


def test_a_part_has_the_costs_of_the_whole(connection: Connection) -> None:
    parts = [BASE, ARM]
    whole = read_scene(connection, "floor-3rd")
    everything = Costmap(whole, parts, grid_of(whole, 0.05))
    box = (5.0, 1.0, 9.0, 3.0)
    near = read_scene(connection, "floor-3rd", bounds=box, margin=1.5)
    assert len(near.things) < len(whole.things)
    some = Costmap(near, parts, grid_of(near, 0.05, box, 1.5))
    for x, y in np.random.default_rng(1).uniform((5, 1), (9, 3), (300, 2)):
        assert some.master[some.cell(x, y)] == everything.master[everything.cell(x, y)]


def test_the_rooms_of_a_route_and_no_other(connection: Connection) -> None:
    scene = read_scene(connection, "floor-3rd", rooms=["corridor3", "office4"], margin=1.0)
    rooms = {p.name for p in scene.places if not p.name.startswith(("door", "edoor"))}
    assert rooms == {"corridor3", "office4"}
    made = Costmap(scene, [BASE], grid_of(scene, 0.05, None, 1.0))
    assert made.master[made.cell(9, 2)] != 255
    assert made.master[made.cell(3.6, 6.6)] == 255, "the foyer"
    with pytest.raises(LookupError, match="no room named offic4; did you mean office4"):
        read_scene(connection, "floor-3rd", rooms=["offic4"])
    with pytest.raises(LookupError, match="no storey named floor-2nd; did you mean"):
        read_scene(connection, "floor-2nd")


def test_a_region_holds_while_it_is_valid(connection: Connection) -> None:
    noon = datetime(2026, 5, 4, 12, tzinfo=UTC)
    home = connection.execute(text("SELECT current_map()")).scalar_one()
    lab = connection.execute(text("SELECT entity_id('lab2')")).scalar_one()
    draw_region(connection, home, "wet", shapely.box(15, 6, 16, 7), type="keepout_zone",
                holder=lab, valid=(None, noon))  # fmt: skip
    for hour, there in ((11, True), (12, False), (13, False)):
        scene = read_scene(connection, "floor-3rd", moment=noon.replace(hour=hour))
        assert ("wet" in by_name(scene.things)) == there
        made = Costmap(scene, [BASE], grid_of(scene, 0.1))
        assert (made.master[made.cell(15.5, 6.5)] == 254) == there
    with pytest.raises(ValueError, match="before it begins"):
        draw_region(connection, home, "wet", shapely.box(15, 6, 16, 7), type="keepout_zone",
                    holder=lab, valid=(noon, noon.replace(hour=9)))  # fmt: skip


def test_what_changes_in_the_database_changes_in_the_costmap(office: Engine) -> None:
    """Moved with its contents, opened and shut, made and taken away; as computed anew each time."""
    changes = (
        "SELECT move_to(entity_id('desk4'), 9.0, 2.4, 7.0, 0.4)",
        "UPDATE connector SET state = 'locked' WHERE entity_id = entity_id('door7')",
        'UPDATE entity SET properties = properties || \'{"workplace": "human"}\' '
        "WHERE id = entity_id('desk7')",
        "DELETE FROM entity WHERE id = entity_id('sofa3')",
        "SELECT move_to(entity_id('slab-3rd'), 0.0, 0.0, 0.0, 0.0)",
    )
    with office.connect() as connection:
        scene = read_scene(connection, "floor-3rd")
        grid = grid_of(scene, 0.05)
        made = Costmap(scene, [BASE, ARM], grid)
        since = cursor(connection)
        connection.rollback()
        for change in changes:
            before = made.master.copy()
            with office.begin() as other:
                other.execute(text(change))
            ids, since = changed_since(connection, since), cursor(connection)
            things = read_things(connection, ids)
            made.update(things, set(ids) - {t.id for t in things})
            anew = Costmap(read_scene(connection, "floor-3rd"), [BASE, ARM], grid)
            assert (made.master == anew.master).all(), change
            assert "slab" in change or (made.master != before).any(), change
            connection.rollback()
        assert changed_since(connection, since) == set()
