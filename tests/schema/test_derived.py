"""Derived tables follow what they are derived from, and nobody writes them by hand."""

from __future__ import annotations

import psycopg
import pytest

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
    room["Table_01"].move_to(3, 3, 0)
    ((x,),) = room.execute("SELECT pose[1] FROM world WHERE entity_id = entity_id('Mug_01')")
    assert x == pytest.approx(room["Mug_01"].pose.x)
    assert room["Mug_01"].pose.x > 2.5
    room.execute("SELECT refresh_world(ARRAY[entity_id('Mug_01')])")
    room.execute("SELECT refresh_beliefs()")
    room.execute("UPDATE entity SET type = 'cup' WHERE name = 'Mug_01'")
    assert room.execute("SELECT 1 FROM object_type WHERE label = 'Mug_01' AND type = 'cup'") == [
        (1,)
    ]
    room.execute("DELETE FROM entity WHERE name = 'Mug_01'")
    assert room.execute("SELECT count(*) FROM belief") == [(0,)]
    room.execute("SELECT copy_map('lounge', 'twin')")
    room.execute("SELECT drop_map('twin')")
    assert room.execute("SELECT count(*) FROM world") == [(2,)]
