"""Objects of real worlds moved at random: the inventory never contradicts the geometry."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path

import pytest
import shapely
from sqlalchemy import Connection, Engine, select, text
from sqlalchemy.orm import Session

import semmap
from planner.mission.behaviours import RobotObservation, Sighting
from planner.mission.store.observations import write_observation
from semmap.cli.demo.choices import DemoChoices, figure_3
from semmap.database.maps import see_map
from semmap.geometry.pose import Pose
from semmap.model import Entity, Placement
from tests.command_line import semmap as semmap_command
from tests.conftest import Import
from tests.consistency import HOLDERS, POSES
from tests.effort import effort
from tests.worlds.conftest import HOUSE, ROOMS, store_slim_robot

WORLDS = {
    "small_house": "small_house/worlds/small_house.world",
    "hotel": "rmf/hotel/hotel.building.yaml",
    "clinic": "rmf/clinic/clinic.building.yaml",
}


INVENTORY = {"stale pose", "wrong room", "wrong holder"}
"""The findings of `Map.check` about the inventory; random moves leave things in the air."""


def faults(world: semmap.Map) -> list[str]:
    return [str(found) for found in world.check() if found.kind in INVENTORY]


@pytest.mark.explore
@pytest.mark.parametrize("name", effort(["small_house", "hotel"], [*WORLDS]))
def test_inventory_follows_random_moves(name: str, worlds: Path, database: str) -> None:
    dice = random.Random(4)
    with semmap.connect(database) as db:
        world = db.create_map(name)
        world.import_file(worlds / WORLDS[name])
        assert faults(world) == []
        objects = [e for e in world.find("object") if e.pose is not None]
        places = [p for e in [*objects, *world.find("room")] if (p := e.pose) is not None]
        before = {e: e.holder for e in objects}
        for _ in range(effort(25, 300)):
            moved, near = dice.choice(objects), dice.choice(places)
            moved.move_to(
                near.x, near.y, near.z + dice.choice((0, 0.4, 0.75, 3)), dice.uniform(-3, 3)
            )
        assert faults(world) == []
        if name == "small_house":
            assert any(e.holder != holder for e, holder in before.items())


ALL_MOVED = """
UPDATE placement p SET pose = pose_compose(pose_inverse(h.pose), there)
FROM world h, (
    SELECT e.id, CASE WHEN r.kind = 'room'
        THEN coalesce(lead(w.pose, 60) OVER turn, first_value(w.pose) OVER turn)
        ELSE pose_compose(w.pose, ARRAY[0.01, 0, 0, 0, 0, 0, 1]) END AS there
    FROM entity e JOIN world w ON w.entity_id = e.id
         JOIN placement q ON q.entity_id = e.id JOIN entity r ON r.id = q.holder_id
    WHERE e.map_id = current_map() AND e.kind = 'object'
    WINDOW turn AS (PARTITION BY r.kind ORDER BY e.id)) t
WHERE p.entity_id = t.id AND h.entity_id = p.holder_id
"""
"""Each object takes the place of one 60 further, often on another storey; walls shift by 1 cm."""

PLACES = """
SELECT e.name, e.kind, h.name AS holder, w.pose, ST_AsBinary(w.footprint) AS footprint,
       r.floor, r.ceiling
FROM entity e JOIN world w ON w.entity_id = e.id LEFT JOIN room r ON r.entity_id = e.id
     LEFT JOIN placement p ON p.entity_id = e.id LEFT JOIN entity h ON h.id = p.holder_id
WHERE e.map_id = current_map() AND e.kind IN ('object', 'room')
"""


def test_all_objects_of_the_hotel_moved_in_one_statement(hotel: Engine) -> None:
    """Each holder is the room, in shapely, whose floor is below the new place."""
    with hotel.begin() as connection:
        see_map(connection, "hotel")
        before = {row.name: row for row in connection.execute(text(PLACES))}
        assert connection.execute(text(ALL_MOVED)).rowcount == 178
    with hotel.connect() as connection:
        see_map(connection, "hotel")
        rows = connection.execute(text(PLACES)).all()
    rooms = [
        (r.name, shapely.from_wkb(bytes(r.footprint)), r.pose[2] + r.floor, r.pose[2] + r.ceiling)
        for r in rows
        if r.kind == "room"
    ]
    objects = [row for row in rows if row.kind == "object"]
    assert all(row.pose != before[row.name].pose for row in objects)
    assert sum(row.holder != before[row.name].holder for row in objects) > 150
    for row in objects:
        x, y, z, *_ = row.pose
        around = {
            name
            for name, floor, low, high in rooms
            if low <= z < high and shapely.distance(floor, shapely.Point(x, y)) < 1e-6
        }
        if row.footprint is None:
            assert row.holder in around, row
        else:
            assert row.holder == before[row.name].holder
    url = hotel.url.render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        assert faults(db.map("hotel")) == []


def test_check_lists_a_holder_that_the_geometry_contradicts(hotel: Engine) -> None:
    """A pose written past the derivation, as only a damaged map has it, is listed."""
    url = hotel.url.render_as_string(hide_password=False)

    def listed() -> list[list[str]]:
        done = semmap_command(url, "check", "--map", "hotel", "--json")
        found = json.loads(done.stdout)
        assert done.exit_code == any(row["severity"] == "error" for row in found)
        return [row["entities"] for row in found if row["kind"] in INVENTORY]

    assert listed() == []
    move = "SELECT move_to(entity_id('DigitalKiosk'), 0, 0, 50)"
    with hotel.begin() as connection:
        see_map(connection, "hotel")
        connection.execute(text("SELECT set_config('semmap.deriving', 'off', true)"))
        connection.execute(text(move))
    assert [names[0] for names in listed()] == ["DigitalKiosk"]
    with hotel.begin() as connection:
        see_map(connection, "hotel")
        connection.execute(text("SELECT derive_again(ARRAY[entity_id('DigitalKiosk')])"))
    assert listed() == []


EDITS = {
    "lower ceilings": "UPDATE room SET ceiling = 0.5",
    "higher floors": "UPDATE room SET floor = 1",
    "rooms drawn elsewhere": "UPDATE gis_room SET geom = ST_Translate(geom, 4, 0)",
    "objects dragged": "UPDATE gis_object SET geom = ST_Translate(geom, 4, 0)",
    "rooms without a shape": "DELETE FROM entity_model em USING room r "
    "WHERE r.entity_id = em.entity_id",
    "rooms without a place": "DELETE FROM placement p USING room r WHERE r.entity_id = p.entity_id",
    "rooms deleted": "DELETE FROM entity WHERE kind = 'room'",
    "tables become walls": "UPDATE entity SET type = 'wall' WHERE type = ANY (subtypes('table'))",
    "every table is a wall": "INSERT INTO type_parent VALUES ('table', 'wall')",
    "tables without a shape": "DELETE FROM entity_model em USING entity e "
    "WHERE e.id = em.entity_id AND e.type = ANY (subtypes('table'))",
    "tables of another shape": "UPDATE entity_model em SET model_id = "
    "(SELECT b.model_id FROM entity_model b WHERE b.entity_id = entity_id('Ball_01_001')) "
    "FROM entity e WHERE e.id = em.entity_id AND e.type = ANY (subtypes('table'))",
    "a storey between": "WITH made AS (INSERT INTO entity (map_id, kind, name) "
    "VALUES (current_map(), 'storey', 'loft') RETURNING id), placed AS ("
    "INSERT INTO placement (entity_id, pose) SELECT id, planar_pose(0, 0, 0, 1) FROM made) "
    "INSERT INTO storey (entity_id) SELECT id FROM made",
}
"""Changes of rooms, types, shapes and storeys, by SQL, the ORM or QGIS."""


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_inventory_follows_each_edit_of_the_small_house(house: Engine, edit: str) -> None:
    """After each edit, some holders are others, and all are as the geometry shows."""
    holders = "SELECT entity_id, holder_id FROM placement ORDER BY entity_id"
    with house.connect() as connection:  # rolled back at the end
        see_map(connection, "house")
        before = connection.execute(text(holders)).all()
        connection.execute(text(edit))
        assert connection.execute(text(HOLDERS)).all() == []
        assert connection.execute(text(POSES)).all() == []
        assert connection.execute(text(holders)).all() != before


TABLET, PLACE = "Tablet_01_001", (6.55, 0.95, 0.9)
"""An object in the living room, and a place on the kitchen's table, metres."""


def move_by_orm(connection: Connection) -> None:
    with Session(connection) as session:
        tablet = session.scalars(select(Entity).where(Entity.name == TABLET)).one()
        placement = session.get_one(Placement, tablet.id)
        assert placement.holder_id is not None
        pose = connection.scalar(
            text("SELECT pose FROM world WHERE entity_id = :id"), {"id": placement.holder_id}
        )
        placement.pose = Pose(*pose).inverse() @ Pose(*PLACE)
        session.flush()


def move_by_api(connection: Connection) -> None:
    here = semmap.connect(connection.engine.url.render_as_string(hide_password=False))
    with here as db:
        db.map("house")[TABLET].move_to(*PLACE)


def move_by_observation(connection: Connection) -> None:
    """A robot sees the tablet, and takes it for one that is still in the living room."""
    robot = connection.execute(
        text(
            "INSERT INTO entity (map_id, kind, name, type) "
            "VALUES (current_map(), 'agent', 'robot', 'robot') RETURNING id"
        )
    ).scalar_one()
    connection.execute(text("INSERT INTO placement (entity_id) VALUES (:id)"), {"id": robot})
    seen = {TABLET: Sighting("living-room", "in", Pose(*PLACE))}
    write_observation(connection, robot, RobotObservation("kitchen", Pose(6, 2), seen=seen))


WAYS: dict[str, str | Callable[[Connection], None]] = {
    "API": move_by_api,
    "ORM": move_by_orm,
    "observation": move_by_observation,
    "function of SQL": "SELECT move_to(entity_id('Tablet_01_001'), 6.55, 0.95, 0.9)",
    "table of SQL": "UPDATE placement p SET pose = pose_compose(pose_inverse(h.pose), "
    "ARRAY[6.55, 0.95, 0.9, 0, 0, 0, 1]) FROM world h WHERE h.entity_id = p.holder_id "
    "AND p.entity_id = entity_id('Tablet_01_001')",
    "QGIS": "UPDATE gis_object SET geom = ST_Translate(geom, 6.55 - ST_X(ST_Centroid(geom)), "
    "0.95 - ST_Y(ST_Centroid(geom))) WHERE name = 'Tablet_01_001'",
}


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_each_way_to_move_a_tablet_into_the_kitchen_is_followed(
    way: str | Callable[[Connection], None], imported: Import, worlds: Path
) -> None:
    """Its holder was the living room, where a plan then picked it up."""
    with imported((worlds / HOUSE, "house"), (ROOMS, "house")) as engine:
        with engine.begin() as connection:
            see_map(connection, "house")
            if isinstance(way, str):
                connection.execute(text(way))
            else:
                way(connection)
        url = engine.url.render_as_string(hide_password=False)
        with semmap.connect(url) as db:
            tablet = db.map("house")[TABLET]
            holder = tablet.holder
            assert holder is not None
            there = holder.name
            assert "kitchen" in (there, holder.holder and holder.holder.name)
        goal = (f"on({TABLET}, CoffeeTable_01_001)", "--from", "kitchen", "--map", "house")
        planned = semmap_command(url, "plan", *goal, "--robot", store_slim_robot(engine))
        assert f"pickup({TABLET}, {there})" in planned.output


def test_what_is_lifted_leaves_figure_3_and_what_was_stated_ends(house: Engine) -> None:
    """A portrait on a night stand is lifted; a ball that is stated to be on it moves away."""
    tables = text(figure_3(DemoChoices("picture", "table")))
    by_hand = "SELECT put(entity_id('Ball_01_001'), entity_id(:stand), 'on')"
    move = "SELECT move_to(entity_id(:name), w.pose[1], w.pose[2], w.pose[3] + :by) FROM world w "
    at = "WHERE w.entity_id = entity_id(:place)"
    with house.connect() as connection:  # rolled back at the end
        see_map(connection, "house")
        stand, *others = (row[1] for row in connection.execute(tables))
        contents = text(
            "SELECT e.name FROM placement p JOIN entity e ON e.id = p.entity_id "
            "WHERE p.holder_id = entity_id(:stand)"
        )
        portraits = connection.scalars(contents, {"stand": stand}).all()
        connection.execute(text(move + at), {"name": "Ball_01_001", "by": 0.7, "place": stand})
        connection.execute(text(by_hand), {"stand": stand})
        for portrait in portraits:
            connection.execute(text(move + at), {"name": portrait, "by": 1, "place": portrait})
        assert [row[1] for row in connection.execute(tables)] == others
        assert connection.scalars(contents, {"stand": stand}).all() == ["Ball_01_001"]

        away = {"name": "Ball_01_001", "by": 0, "place": "KitchenTable_01_001"}
        connection.execute(text(move + at), away)
        assert connection.scalars(contents, {"stand": stand}).all() == []
        reason = connection.scalar(
            text(
                "SELECT reason FROM placement_history WHERE entity_id = entity_id('Ball_01_001') "
                "AND reason IS NOT NULL ORDER BY upper(during) DESC LIMIT 1"
            )
        )
        assert reason == "the geometry contradicted the stated holder"
        assert connection.execute(text(HOLDERS)).all() == []
