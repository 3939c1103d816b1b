"""Roles have just the rights that they need: a table of who may do what."""

from __future__ import annotations

import pytest
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from semmap.geometry.pose import Pose
from semmap.model import Connector, Placement, Room
from tests.model.test_placement import new_map, thing

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
MISSION = "INSERT INTO mission (map_id, robot_id, goal) VALUES ({map}, {mug}, 'on(mug, desk)')"
PURSUE = (
    f"{MISSION}; INSERT INTO reservation (resource_id, robot_id, expires) "
    "VALUES ({door}, {mug}, 'infinity'); DELETE FROM reservation"
)
FORGET_MISSION = f"{MISSION}; DELETE FROM mission"
TABLE = "CREATE TABLE semmap.mine (id int)"

RIGHTS = {
    "semmap_reader": {READ, FIGURE_3},
    "semmap_robot": {
        READ, FIGURE_3, SEE, SEE_PLACED, MOVE, DESCRIBE, CLOSE, KEEP, KEEP_AND_FORGET, PURSUE,
    },
    "semmap_admin": {
        READ, FIGURE_3, SEE, SEE_PLACED, MOVE, DESCRIBE, CLOSE, MOVE_ROOM, RENAME, DESCRIBE_ROOM,
        REHANG, NEW_ROOM, DELETE, NEW_TYPE, NEW_MAP, RECOMPUTE, KEEP, KEEP_AND_FORGET,
        PURSUE, FORGET_MISSION,
    },
}  # fmt: skip
STATEMENTS = [
    READ, FIGURE_3, SEE, SEE_PLACED, MOVE, MOVE_ROOM, DESCRIBE, RENAME, DESCRIBE_ROOM, CLOSE,
    REHANG, NEW_ROOM, DELETE, NEW_TYPE, NEW_MAP, FORGE_WORLD, FORGE_HISTORY, FORGE_CHANGE,
    RECOMPUTE, TABLE, KEEP, KEEP_AND_FORGET, PURSUE, FORGET_MISSION,
]  # fmt: skip


@pytest.mark.parametrize("statement", STATEMENTS)
@pytest.mark.parametrize("role", RIGHTS)
def test_rights(engine: Engine, role: str, statement: str) -> None:
    with Session(engine) as session:
        of = new_map(session)
        room = Room(map=of, name="room", type="room", placement=Placement())
        session.add(room)
        session.flush()
        mug = thing(session, of, "mug", room, Pose(x=1))
        door = Connector(map=of, name="door", place_a=room, pose_a=Pose(x=-1), pose_b=Pose(x=1))
        session.add(door)
        session.flush()
        ids = {"map": of.id, "room": room.id, "mug": mug.id, "door": door.id}
        session.execute(text(f"SET LOCAL ROLE {role}"))
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
