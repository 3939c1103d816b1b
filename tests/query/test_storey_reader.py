"""Storeys read from the database: the office, and small worlds with objects across storeys."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely
from sqlalchemy import Connection, Engine, text

from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.ingest.store.world_store import store_world
from semmap.ingest.world import Entry, Shape, World
from semmap.query.geometry_notes import geometry_lists
from semmap.query.storey_reader import (
    read_entities,
    read_scene,
    read_storey_names,
    read_storeys,
)
from semmap.query.storey_scene import SceneEntity
from tests.seen import seen_by


@pytest.fixture(scope="module")
def office(office_world: Engine) -> Engine:
    """A database that holds the office."""
    return office_world


@pytest.fixture
def connection(office: Engine) -> Iterator[Connection]:
    with office.connect() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'office', true)"))
        yield connection
        connection.rollback()


def by_name(entities: Iterable[SceneEntity]) -> dict[str, SceneEntity]:
    return {entity.name: entity for entity in entities}


def box(name: str, low: tuple[float, ...], high: tuple[float, ...], type_: str) -> Entry:
    return Entry(name, "object", type_, shapes=[Shape("mesh", box_mesh(low, high))])


def stored(
    connection: Connection, *entries: Entry, storeys: dict[str, float] | None = None
) -> None:
    """Make a map of entries, and see it until the end of the transaction."""
    made = connection.execute(text("INSERT INTO map (name) VALUES ('small') RETURNING id"))
    number = made.scalar_one()
    connection.execute(text("SELECT set_config('semmap.map', 'small', true)"))
    for name, elevation in (storeys or {}).items():
        entity = connection.execute(
            text(
                "INSERT INTO entity (map_id, name, kind) VALUES (:map, :name, 'storey') "
                "RETURNING id"
            ),
            {"map": number, "name": name},
        ).scalar_one()
        connection.execute(
            text("INSERT INTO storey (entity_id, elevation) VALUES (:id, :elevation)"),
            {"id": entity, "elevation": elevation},
        )
    driver = connection.connection.driver_connection
    assert driver is not None
    store_world(driver, number, World("small", Path("small"), [*entries]), "test")


# -- the office ---------------------------------------------------------------------------------


def test_a_scene_has_all_entities_that_reach_into_the_storey(connection: Connection) -> None:
    assert read_storey_names(seen_by(connection)) == ["floor-1st", "floor-3rd"]
    first, third = (read_scene(seen_by(connection), name) for name in ("floor-1st", "floor-3rd"))
    assert (first.elevation, third.elevation) == (0.0, 7.0)
    assert {"desk4", "walls-3rd", "door6"} <= set(by_name(third.entities))
    assert not {"desk4", "door6", "office4"} & set(by_name(first.entities))
    assert {area.name for area in third.floors} >= {"office4", "lab2", "door6"}
    assert {area.floor for area in third.floors} == {7.0}
    stairs = by_name(first.entities)["staircase"]
    assert stairs.footprint is not None
    hole = shapely.box(0, 1.8, 1.2, 4.6)
    assert stairs.footprint.symmetric_difference(hole).area < 1e-9


def test_triangles_are_in_the_maps_frame(connection: Connection) -> None:
    desk = by_name(read_scene(seen_by(connection), "floor-3rd").entities)["desk4"]
    low, high = connection.execute(
        text(
            "SELECT ARRAY[ST_XMin(box), ST_YMin(box), ST_ZMin(box)], "
            "ARRAY[ST_XMax(box), ST_YMax(box), ST_ZMax(box)] FROM world "
            "WHERE entity_id = entity_id('desk4')"
        )
    ).one()
    corners = desk.triangles.reshape(-1, 3)
    np.testing.assert_allclose(corners.min(0), low, atol=1e-6)
    np.testing.assert_allclose(corners.max(0), high, atol=1e-6)
    assert desk.types[0] == "desk"
    assert "furniture" in desk.types


def test_a_shut_door_without_a_mesh_is_the_box_of_its_opening(connection: Connection) -> None:
    connection.execute(
        text("UPDATE connector SET state = 'closed' WHERE entity_id = entity_id('door6')")
    )
    door = by_name(read_scene(seen_by(connection), "floor-3rd").entities)["door6"]
    assert door.state == "closed"
    corners = door.triangles.reshape(-1, 3)
    np.testing.assert_allclose(np.ptp(corners, axis=0), [0.9, 0.05, 2.1], atol=1e-9)
    np.testing.assert_allclose(corners.mean(0)[:2], [5.7, 4.1], atol=0.05)


def test_unknown_storeys_and_rooms_are_refused_with_a_suggestion(connection: Connection) -> None:
    with pytest.raises(LookupError, match="no room named offic4; did you mean office4"):
        read_scene(seen_by(connection), "floor-3rd", rooms=["offic4"])
    for read in (read_scene, read_storeys):
        with pytest.raises(LookupError, match="no storey named floor-2nd; did you mean floor-"):
            read(seen_by(connection), "floor-2nd")


def test_a_storey_among_all_equals_its_scene(connection: Connection) -> None:
    storeys = read_storeys(seen_by(connection))
    assert [storey.storey for storey in storeys] == ["floor-1st", "floor-3rd"]
    for storey in storeys:
        alone = read_scene(seen_by(connection), storey.storey)
        assert (storey.elevation, storey.band) == (alone.elevation, alone.band)
        assert [e.name for e in storey.entities] == [e.name for e in alone.entities]
        assert [a.name for a in storey.floors] == [a.name for a in alone.floors]
        for one, other in zip(storey.entities, alone.entities, strict=True):
            np.testing.assert_array_equal(one.triangles, other.triangles)


def test_each_entity_is_in_the_inventory_of_one_storey(connection: Connection) -> None:
    storeys = read_storeys(seen_by(connection))
    names = [entity.name for storey in storeys for entity in storey.inventory]
    placed = connection.execute(
        text(
            "SELECT e.name FROM entity e JOIN world w ON w.entity_id = e.id "
            "WHERE e.map_id = current_map() "
            "AND e.kind IN ('room', 'object', 'region', 'connector', 'agent')"
        )
    ).scalars()
    assert sorted(names) == sorted(placed)
    assert {"desk4", "lab2"} <= set(by_name(storeys[1].inventory))
    assert {entity.storey for entity in storeys[1].inventory} == {"floor-3rd"}


def test_entities_are_read_by_id_and_kind(connection: Connection) -> None:
    ids = connection.execute(
        text("SELECT array_agg(id) FROM entity WHERE name IN ('desk4', 'lab2', 'door6')")
    ).scalar_one()
    assert [e.name for e in read_entities(seen_by(connection), ids, kinds=["object"])] == ["desk4"]
    assert set(by_name(read_entities(seen_by(connection), ids))) == {"desk4", "lab2", "door6"}
    assert read_entities(seen_by(connection), ids, storey="floor-1st") == []
    assert not len(read_entities(seen_by(connection), ids, triangles=False)[0].triangles)


# -- objects across storeys, and floors that no room states --------------------------------------


def test_an_object_is_in_each_storey_that_it_reaches_into(connection: Connection) -> None:
    wall = box("wall1", (1, 1, 0), (7, 1.2, 6), "wall")
    stored(connection, wall, storeys={"ground": 0.0, "upper": 3.0})
    lower, upper = read_storeys(seen_by(connection))
    assert "wall1" in by_name(lower.entities)
    assert "wall1" in by_name(upper.entities)
    assert "wall1" in by_name(lower.inventory)
    assert "wall1" not in by_name(upper.inventory)
    assert "wall1" in by_name(read_scene(seen_by(connection), "upper").entities)


def test_the_floor_is_measured_where_no_room_states_it(connection: Connection) -> None:
    ground = box("ground1", (0, 0, -0.1), (6, 4, 0.034), "ground")
    cup = box("cup1", (1, 1, 0.034), (1.1, 1.1, 0.134), "cup")
    stored(connection, ground, cup)
    assert read_scene(seen_by(connection), "small").elevation == pytest.approx(0.034)
    (storey,) = read_storeys(seen_by(connection))
    assert storey.elevation == pytest.approx(0.034)


def test_a_map_without_floor_meshes_has_the_floor_on_which_objects_stand(
    connection: Connection,
) -> None:
    cups = [box(f"cup{n}", (n, 0, 1.5), (n + 0.1, 0.1, 1.6), "cup") for n in range(3)]
    lamp = box("lamp1", (9, 0, 3.0), (9.1, 0.1, 3.1), "lamp")
    stored(connection, *cups, lamp)
    assert read_scene(seen_by(connection), "small").elevation == pytest.approx(1.5)


def test_objects_without_geometry_are_listed_separately(connection: Connection) -> None:
    stored(connection, Entry("bed1", "object", "bed", pose=Pose(1.0, 1.0, 0.0)))
    scene = read_scene(seen_by(connection), "small")
    assert geometry_lists(scene.entities)["no_geometry"] == ["bed1"]


def test_an_empty_map_is_refused(connection: Connection) -> None:
    connection.execute(text("INSERT INTO map (name) VALUES ('small')"))
    connection.execute(text("SELECT set_config('semmap.map', 'small', true)"))
    with pytest.raises(LookupError, match="the map is empty: semmap import FILE"):
        read_storeys(seen_by(connection))
