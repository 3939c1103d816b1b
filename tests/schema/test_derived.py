"""Derived tables follow what they are derived from, and nobody writes them by hand."""

from __future__ import annotations

import psycopg
import pytest

import semmap
from tests.conftest import MakeDatabase

SOURCES = {
    "world": "gis_object",
    "section": "models of the entity",
    "entity_chunk": "entity_model",
    "object_type": "entity.type",
    "type_closure": "type_parent",
    "entity_object": "object_mesh",
    "belief": "observation",
}
DIRECT = [
    "UPDATE {0} SET {1} = {1}",
    "DELETE FROM {0}",
    "INSERT INTO {0} SELECT * FROM {0}",
    "TRUNCATE {0} CASCADE",
    "WITH gone AS (DELETE FROM {0} RETURNING 1) SELECT count(*) FROM gone",
    "DO $$ BEGIN DELETE FROM {0}; END $$",
]


@pytest.fixture(scope="module")
def room(make_database: MakeDatabase):
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        made = db.create_map("room")
        made.add_room("hall", [(0, 0), (6, 0), (6, 5), (0, 5)], floor=0, ceiling=2.7)
        made.add_object("table", type="table", size=(1.2, 0.8, 0.75), pose=(2, 2, 0, 0))
        made.add_object("mug", type="mug", size=(0.1, 0.1, 0.1), on="table")
        made.observe("mug", "table")
        yield made


@pytest.mark.parametrize("name", SOURCES)
@pytest.mark.parametrize("statement", DIRECT)
def test_the_owner_writes_no_derived_table(room, name: str, statement: str) -> None:
    """It is refused with what to edit, and changes nothing."""
    ((column,),) = room.execute(
        "SELECT attname FROM pg_attribute WHERE attrelid = %s::regclass AND attnum = 1",
        f"semmap.{name}",
    )
    state = f"SELECT count(*), md5(string_agg(t::text, '' ORDER BY t::text)) FROM {name} t"
    before = room.execute(state)
    with pytest.raises(psycopg.errors.InsufficientPrivilege, match=f"{name} is derived") as refused:
        room.execute(statement.format(name, column))
    assert SOURCES[name] in str(refused.value.diag.message_hint)
    assert room.execute(state) == before


def test_what_derives_them_writes_them(room) -> None:
    """Moves, meshes, types, beliefs, repairs, copies and their end."""
    room["table"].move_to(3, 3, 0)
    ((x,),) = room.execute("SELECT pose[1] FROM world WHERE entity_id = entity_id('mug')")
    assert x == pytest.approx(room["mug"].pose.x)
    assert room["mug"].pose.x > 2.5
    room.execute("SELECT refresh_world(ARRAY[entity_id('mug')])")
    room.execute("SELECT refresh_beliefs()")
    room.execute("UPDATE entity SET type = 'cup' WHERE name = 'mug'")
    assert room.execute("SELECT 1 FROM object_type WHERE label = 'mug' AND type = 'cup'") == [(1,)]
    room.execute("DELETE FROM entity WHERE name = 'mug'")
    assert room.execute("SELECT count(*) FROM belief") == [(0,)]
    room.execute("SELECT copy_map('room', 'twin')")
    room.execute("SELECT drop_map('twin')")
    assert room.execute("SELECT count(*) FROM world") == [(2,)]
