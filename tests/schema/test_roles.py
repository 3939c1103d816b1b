"""Roles have just the rights that they need: a table of who may do what."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from shapely import box
from sqlalchemy import Engine, create_engine, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from semmap.geometry.pose import Pose
from semmap.ingest.importer import import_file
from semmap.ingest.regions.extraction import draw_region
from semmap.model import Connector, Placement, Room
from tests.model.test_placement import new_map, thing

OFFICE = Path(__file__).parents[2] / "examples" / "office"
READ = "SELECT count(*) FROM entity, placement, world, map, change LIMIT 1"
FIGURE_3 = "SELECT count(*) FROM object, inventory, face, fa_to_ob"
SEE = "INSERT INTO entity (map_id, kind, name, type) VALUES ({map}, 'object', 'seen', 'object')"
SEE_PLACED = SEE + "; INSERT INTO placement (entity_id) SELECT id FROM entity WHERE name = 'seen'"
MOVE = "UPDATE placement SET pose[1] = 3 WHERE entity_id = {mug}"
MOVE_ROOM = "UPDATE placement SET pose[1] = 3 WHERE entity_id = {room}"
DESCRIBE = "UPDATE entity SET properties = '{{\"full\": true}}' WHERE id = {mug}"
RENAME = "UPDATE entity SET name = 'x' WHERE id = {mug}"
DESCRIBE_ROOM = "UPDATE entity SET label = 'x' WHERE id = {room}"
CLOSE = "UPDATE connector SET state = 'closed' WHERE entity_id = {door}"
REHANG = "UPDATE connector SET place_b = NULL WHERE entity_id = {door}"
NEW_ROOM = "INSERT INTO entity (map_id, kind, name) VALUES ({map}, 'room', 'new')"
DELETE = "DELETE FROM entity WHERE id = {mug}"
NEW_TYPE = "INSERT INTO semantic_type (name) VALUES ('gizmo')"
NEW_MAP = "INSERT INTO map (name) VALUES ('gizmo')"
FORGE_WORLD = "UPDATE world SET map_id = 7"
FORGE_HISTORY = "DELETE FROM placement_history"
FORGE_CHANGE = "INSERT INTO change (map_id, what, entities) VALUES ({map}, 'moved', '{{1}}')"
RECOMPUTE = "SELECT refresh_world('{{1}}')"
KEEP = (
    "INSERT INTO field (map_id, name, property, value_type, voxel_size, edge) "
    "VALUES ({map}, 'space', 'urn:x', 'bool', 0.05, 32)"
)
KEEP_AND_FORGET = KEEP + "; DELETE FROM field"
MISSION = "INSERT INTO mission (map_id, robot_id, goal) VALUES ({map}, {own}, 'on(mug, desk)')"
PURSUE = (
    f"{MISSION}; SELECT 1 / claim({{door}}, {{own}}, 30)::int; "
    "UPDATE mission SET state = 'done', ended_at = now() WHERE robot_id = {own}; "
    "DELETE FROM reservation WHERE robot_id = {own}"
)
FORGET_MISSION = f"{MISSION}; DELETE FROM mission"
THEIR_MISSION = (
    "INSERT INTO mission (map_id, robot_id, goal) VALUES ({map}, {other}, 'on(mug, desk)')"
)
CANCEL_THEIRS = "UPDATE mission SET state = 'cancelled', ended_at = now() WHERE robot_id = {other}"
TAKE_THEIRS = "UPDATE mission SET robot_id = {own} WHERE robot_id = {other}"
FAIL_THEIR_STEP = "UPDATE mission_step SET cause = 'x' WHERE mission_id = {mission}"
ADD_THEIR_STEP = (
    "INSERT INTO mission_step (mission_id, number, action, arguments, command) "
    "VALUES ({mission}, 9, 'x', '{{}}', '{{}}')"
)
FORGET_THEIR_STEP = "DELETE FROM mission_step WHERE mission_id = {mission}"
CLAIM_FOR_THEM = "SELECT 1 / claim({door}, {other}, 30)::int"
RENEW_THEIRS = "UPDATE reservation SET expires = now() + '1 minute' WHERE robot_id = {other}"
OWN_THEIRS = "UPDATE reservation SET robot_id = {own} WHERE robot_id = {other}"
RELEASE_THEIRS = "DELETE FROM reservation WHERE robot_id = {other}"
MOVE_THEM = "SELECT move_to({other}, 1, 2, 3)"
MOVE_ITSELF = "SELECT move_to({own}, 1, 2, 3)"
BACKDATE = "INSERT INTO placement (entity_id, since) VALUES ({lost}, '2000-01-01')"
BACKDATE_ENTITY = (
    "INSERT INTO entity (map_id, kind, name, since) VALUES ({map}, 'object', 'x', '2000-01-01')"
)
BACKDATE_MOVE = "UPDATE placement SET since = '2000-01-01' WHERE entity_id = {mug}"
BACKDATE_EXECUTION = (
    "INSERT INTO execution (behaviour, entity_id, at, seconds, succeeded) "
    "VALUES ('pass_door', {door}, '2000-01-01', 1, true)"
)
EXECUTED = (
    "INSERT INTO execution (behaviour, entity_id, seconds, succeeded) "
    "VALUES ('pass_door', {door}, 1, true)"
)
NEW_CLASS = (
    "INSERT INTO robot_class (name, max_step, max_slope, speed, reach, heights, capacity, "
    "call_seconds, ride_seconds, ride_seconds_per_metre, open_seconds, unlock_seconds, "
    "pickup_seconds, place_seconds) VALUES ('own', 0, 0, 1, '{{0,1}}', '{{0,1}}', 1, "
    "1, 1, 1, 1, 1, 1, 1)"
)
DELETE_CLASS = "DELETE FROM robot_class WHERE name = 'all'"
SLOW_CLASS = "UPDATE robot_class SET speed = 0.001 WHERE name = 'all'"
FORGE_BY_FUNCTION = "SELECT record_change('moved', '{{1}}')"
DELETE_TYPES = "DELETE FROM object"
EMPTY_INVENTORY = "DELETE FROM inventory"
FORGET_HISTORY = "SELECT prune_history()"
LOCK = "SELECT lock_holders('{{1}}')"
SPOIL_UNUSED = (
    "INSERT INTO chunk (model_id, number, geom) SELECT {spare}, 9, geom FROM chunk LIMIT 1"
)
FORGE_LEVEL = "INSERT INTO support_surface (model_id, number) VALUES ({spare}, 0)"
DROP_UNUSED = "DELETE FROM model WHERE id = {spare}"
TABLE = "CREATE TABLE semmap.mine (id int)"
DROP = "SELECT drop_map((SELECT name FROM map WHERE id = {map}))"
SHAPE = "INSERT INTO entity_model (entity_id, model_id) VALUES ({mug}, {model})"
SHAPE_ROOM = "INSERT INTO entity_model (entity_id, model_id) VALUES ({room}, {model})"
MESH = (
    "INSERT INTO model (digest, kind, triangles, hull) SELECT 'own', 'mesh', triangles, hull "
    "FROM model WHERE id = {model}; INSERT INTO chunk (model_id, number, geom) "
    "SELECT currval(pg_get_serial_sequence('semmap.model', 'id')), 0, geom FROM chunk "
    "WHERE model_id = {model}"
)
SPOIL_MESH = "INSERT INTO chunk (model_id, number, geom) SELECT {model}, 9, geom FROM chunk LIMIT 1"
BOUND = (
    "INSERT INTO entity (map_id, kind, name) VALUES ({map}, 'region', 'wet'); "
    "INSERT INTO region (entity_id) SELECT id FROM entity WHERE name = 'wet'; "
    "UPDATE region SET valid = '[2026-01-01, 2026-01-02)'"
)
BOUND_ROOM = "INSERT INTO region (entity_id) VALUES ({room})"
LINK = "INSERT INTO link VALUES ({mug}, 'belongs_to', {room})"
LINK_ROOM = "INSERT INTO link VALUES ({room}, 'belongs_to', {mug})"
MOVE_TO = "SELECT move_to({mug}, 1, 2, 3)"
MOVE_ROOM_TO = "SELECT move_to({room}, 1, 2, 3)"
PUT_ROOM = "SELECT put({room}, NULL)"

UNSHAPE = "DELETE FROM entity_model WHERE entity_id = {door}"

RIGHTS = {
    "semmap_reader": {READ, FIGURE_3},
    "semmap_robot": {
        READ,
        FIGURE_3,
        SEE,
        SEE_PLACED,
        MOVE,
        DESCRIBE,
        CLOSE,
        KEEP,
        KEEP_AND_FORGET,
        PURSUE,
        SHAPE,
        MESH,
        BOUND,
        LINK,
        MOVE_TO,
        MOVE_ITSELF,
        EXECUTED,
        NEW_CLASS,
    },
    "semmap_admin": {
        READ,
        FIGURE_3,
        SEE,
        SEE_PLACED,
        MOVE,
        DESCRIBE,
        CLOSE,
        MOVE_ROOM,
        RENAME,
        DESCRIBE_ROOM,
        REHANG,
        NEW_ROOM,
        DELETE,
        NEW_TYPE,
        NEW_MAP,
        KEEP,
        KEEP_AND_FORGET,
        PURSUE,
        FORGET_MISSION,
        DROP,
        SHAPE,
        SHAPE_ROOM,
        MESH,
        SPOIL_MESH,
        BOUND,
        BOUND_ROOM,
        LINK,
        LINK_ROOM,
        MOVE_TO,
        MOVE_ROOM_TO,
        PUT_ROOM,
        UNSHAPE,
        THEIR_MISSION,
        CANCEL_THEIRS,
        TAKE_THEIRS,
        FAIL_THEIR_STEP,
        ADD_THEIR_STEP,
        FORGET_THEIR_STEP,
        RENEW_THEIRS,
        OWN_THEIRS,
        RELEASE_THEIRS,
        CLAIM_FOR_THEM,
        MOVE_THEM,
        MOVE_ITSELF,
        BACKDATE,
        BACKDATE_ENTITY,
        BACKDATE_MOVE,
        BACKDATE_EXECUTION,
        EXECUTED,
        NEW_CLASS,
        DELETE_CLASS,
        SLOW_CLASS,
        FORGET_HISTORY,
        SPOIL_UNUSED,
        FORGE_LEVEL,
        DROP_UNUSED,
    },
}
STATEMENTS = [
    READ,
    FIGURE_3,
    SEE,
    SEE_PLACED,
    MOVE,
    MOVE_ROOM,
    DESCRIBE,
    RENAME,
    DESCRIBE_ROOM,
    CLOSE,
    REHANG,
    NEW_ROOM,
    DELETE,
    NEW_TYPE,
    NEW_MAP,
    FORGE_WORLD,
    FORGE_HISTORY,
    FORGE_CHANGE,
    RECOMPUTE,
    TABLE,
    KEEP,
    KEEP_AND_FORGET,
    PURSUE,
    FORGET_MISSION,
    DROP,
    SHAPE,
    SHAPE_ROOM,
    MESH,
    SPOIL_MESH,
    BOUND,
    BOUND_ROOM,
    LINK,
    LINK_ROOM,
    MOVE_TO,
    MOVE_ROOM_TO,
    PUT_ROOM,
    UNSHAPE,
    THEIR_MISSION,
    CANCEL_THEIRS,
    TAKE_THEIRS,
    FAIL_THEIR_STEP,
    ADD_THEIR_STEP,
    FORGET_THEIR_STEP,
    CLAIM_FOR_THEM,
    RENEW_THEIRS,
    OWN_THEIRS,
    RELEASE_THEIRS,
    MOVE_THEM,
    MOVE_ITSELF,
    BACKDATE,
    BACKDATE_ENTITY,
    BACKDATE_MOVE,
    BACKDATE_EXECUTION,
    EXECUTED,
    NEW_CLASS,
    DELETE_CLASS,
    SLOW_CLASS,
    FORGE_BY_FUNCTION,
    DELETE_TYPES,
    EMPTY_INVENTORY,
    FORGET_HISTORY,
    LOCK,
    SPOIL_UNUSED,
    FORGE_LEVEL,
    DROP_UNUSED,
]


MODEL = (
    "WITH made AS (INSERT INTO model (digest, kind, triangles, hull) SELECT 'box', 'box', 12, "
    "ST_Collect(ST_MakePoint(i % 2, i / 2 % 2, i / 4)) FROM generate_series(0, 7) i RETURNING id), "
    "meshed AS (INSERT INTO chunk (model_id, number, geom) SELECT id, 0, "
    "prism_tin(ST_MakeEnvelope(0, 0, 1, 1), 0, 1) FROM made) SELECT id FROM made"
)


@pytest.mark.parametrize("statement", STATEMENTS)
@pytest.mark.parametrize("role", RIGHTS)
def test_rights(module_engine: Engine, role: str, statement: str) -> None:
    own, other = f"own_{os.getpid()}", f"other_{os.getpid()}"  # roles are the whole server's
    with Session(module_engine) as session:
        ids = scene(session, own, other)
        session.execute(text(f"SET LOCAL ROLE {own if role == 'semmap_robot' else role}"))
        allowed = True
        try:
            for part in statement.format(**ids).split("; "):
                allowed &= session.execute(text(part)).rowcount != 0  # type: ignore[attr-defined]
            session.execute(text("SET CONSTRAINTS ALL IMMEDIATE"))
        except DBAPIError as error:
            if getattr(error.orig, "sqlstate", None) != "42501":  # insufficient_privilege
                raise
            allowed = False
        session.rollback()
    assert allowed == (statement in RIGHTS[role])


def scene(session: Session, own: str, other: str) -> dict[str, int]:
    """A room with a mug and a door, and two robots with their roles: their ids by name."""
    for name in (own, other):
        session.execute(text(f"CREATE ROLE {name} IN ROLE semmap_robot"))
    of = new_map(session)
    room = Room(map=of, name="room", type="room", placement=Placement())
    session.add(room)
    session.flush()
    mug = thing(session, of, "mug", room, Pose(x=1))
    door = Connector(map=of, name="door", place_a=room, pose_a=Pose(x=-1), pose_b=Pose(x=1))
    session.add(door)
    session.flush()
    model = session.execute(text(MODEL)).scalar_one()
    session.execute(
        text("INSERT INTO entity_model VALUES (:id, :model)"), {"id": door.id, "model": model}
    )
    ids = {"map": of.id, "room": room.id, "mug": mug.id, "door": door.id, "model": model}
    return ids | others(session, of.id, own, other)


def others(session: Session, of: int, own: str, other: str) -> dict[str, int]:
    """Two robots, what the other one pursues and has claimed, a class, an unused model."""

    def made(statement: str, **values: object) -> int:
        return int(session.execute(text(statement + " RETURNING id"), values).scalar_one())

    ids = {
        key: made(
            "INSERT INTO entity (map_id, kind, name) VALUES (:of, :kind, :name)",
            of=of,
            kind=kind,
            name=name,
        )
        for key, kind, name in [
            ("own", "agent", own),
            ("other", "agent", other),
            ("lost", "object", "lost"),
            ("gate", "connector", "gate"),
        ]
    }
    for key in ("own", "other"):
        session.execute(text(f"INSERT INTO placement (entity_id) VALUES ({ids[key]})"))
    ids["mission"] = made(
        "INSERT INTO mission (map_id, robot_id, goal) VALUES (:of, :other, 'x')",
        of=of,
        other=ids["other"],
    )
    session.execute(
        text(
            "INSERT INTO mission_step (mission_id, number, action, arguments, command) "
            "VALUES (:mission, 1, 'x', '{}', '{}')"
        ),
        ids,
    )
    session.execute(text("SELECT claim(:gate, :other, 30)"), ids)
    session.execute(text(NEW_CLASS.format().replace("'own'", "'all'")))
    ids["spare"] = session.execute(
        text(MODEL.replace("'box', 'box'", "'spare', 'box'"))
    ).scalar_one()
    return ids


def as_role(engine: Engine, role: str) -> Engine:
    """Another engine on the same database, in that role from the first statement on."""
    options = f"-c role={role} -c search_path=semmap,public"
    return create_engine(engine.url, connect_args={"options": options})


def test_an_admin_imports_changes_and_drops_a_map(engine: Engine) -> None:
    admin = as_role(engine, "semmap_admin")
    files = [OFFICE / "office.sdf", OFFICE / "office_rooms.geojson"]
    for file in files:
        mine = import_file(admin, file, map_name="mine")
        theirs = import_file(engine, file, map_name="theirs")
        assert (mine.added, mine.holders) == (theirs.added, theirs.holders)
        assert import_file(admin, file, map_name="mine").unchanged == mine.added
    count = text(
        "SELECT count(*) FROM entity e JOIN map m ON m.id = e.map_id WHERE m.name = 'mine'"
    )
    with admin.begin() as connection:
        assert connection.execute(count).scalar_one() > 200
        connection.execute(text("SELECT drop_map('mine')"))
        assert connection.execute(count).scalar_one() == 0
    admin.dispose()


def test_a_reader_and_a_robot_import_nothing(engine: Engine) -> None:
    for role in ("semmap_reader", "semmap_robot"):
        other = as_role(engine, role)
        with pytest.raises(DBAPIError, match="permission denied") as said:
            import_file(other, OFFICE / "office.sdf", map_name="theirs")
        assert getattr(said.value.orig, "sqlstate", None) == "42501"
        other.dispose()


def test_a_robot_draws_a_region_and_redraws_it(engine: Engine) -> None:
    import_file(engine, OFFICE / "office_rooms.geojson", map_name="theirs")
    robot = as_role(engine, "semmap_robot")
    areas = []
    for side in (1.0, 2.0):
        with robot.begin() as connection:
            number = connection.execute(text("SELECT current_map()")).scalar_one()
            outline = box(12.0, 2.0, 12.0 + side, 3.0)
            lab = connection.execute(text("SELECT entity_id('lab1')")).scalar_one()
            draw_region(connection, number, "wet", outline, holder=lab, type="blocked_region")
        with robot.connect() as connection:
            areas.append(
                connection.execute(
                    text("SELECT ST_Area(footprint) FROM world WHERE entity_id = entity_id('wet')")
                ).scalar_one()
            )
    assert areas == pytest.approx([1.0, 2.0])
    robot.dispose()
