"""Each role calls every function that writes, reads files or stores large objects.

The functions are those of the catalogue: a new one without an entry here fails the test.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from semmap.database import as_reader
from semmap.database.rights import FOR_WRITERS
from tests.schema.test_roles import scene

DENIED = "42501"  # insufficient_privilege
OWN, OTHER, STRANGER = (f"{name}_{os.getpid()}" for name in ("calls", "called", "stranger"))
ROLES = {
    "stranger": STRANGER,
    "reader": "semmap_reader",
    "login": "semmap_read",
    "robot": OWN,
    "admin": "semmap_admin",
}
"""A role of each kind: `login` is that of ``semmap sql``, a stranger is a member of none."""

WRITERS = {"robot", "admin"}
CALLS: dict[str, set[str]] = {
    "apply_retention()": set(),
    "check_holders('{{{mug}}}')": set(),
    "claim({door}, {own}, 30)": WRITERS,
    "claim({door}, {other}, 30)": {"admin"},
    "copy_map((SELECT name FROM semmap.map WHERE id = {map}), 'copy')": {"admin"},
    "derive_again('{{{mug}}}')": {"admin"},
    "drawn_model(ST_Multi(ST_MakeEnvelope(0, 0, 1, 1)), 0, 1)": WRITERS,
    "drop_map((SELECT name FROM semmap.map WHERE id = {map}))": {"admin"},
    "drop_unused_models()": {"admin"},
    "end_idle_robots()": WRITERS,
    "former_span('semmap.placement_history', {mug}, now(), now())": set(),
    "find_objects('{{{mug}}}')": set(),
    "fit_shape({mug}, '{{0,0,0,0,0,0,1}}', 1, 0)": {"admin"},
    "follow_change('{{{mug}}}')": {"admin"},
    "follow_geometry('{{{mug}}}', '{{}}')": set(),
    "hold_still({mug}, {room})": WRITERS,
    "hold_still({room}, NULL)": {"admin"},
    "hold_still({other}, NULL)": {"admin"},
    "keep_relation({map}, 'near')": {*ROLES} - {"stranger"},
    "lock_holders('{{{mug}}}')": set(),
    "move_to({mug}, 1, 2, 3)": WRITERS,
    "move_to({own}, 1, 2, 3)": WRITERS,
    "move_to({other}, 1, 2, 3)": {"admin"},
    "move_to({room}, 1, 2, 3)": {"admin"},
    "prune_changes()": {"admin"},
    "prune_observations()": {"admin"},
    "prune_terms()": {"admin"},
    "prune_written()": {"admin"},
    "note_write(gen_random_uuid())": WRITERS,
    "was_written(gen_random_uuid())": WRITERS,
    "undo_teaching(0)": {"admin"},
    "term_ids('{{urn:a}}', '{{I}}')": WRITERS,
    "follow_sighting({mug})": set(),
    "prune_history()": {"admin"},
    "put({mug}, NULL)": WRITERS,
    "put({other}, NULL)": {"admin"},
    "put({room}, NULL)": {"admin"},
    "put_door({door}, {map}, NULL, 'd', 'LINESTRING(501 1, 501 -1)')": {"admin"},
    "queue_writer()": WRITERS,
    "recognise_parts('{{{mug}}}')": {"admin"},
    "record_change('moved', '{{{mug}}}')": set(),
    "record_moves('[[{mug}, null, null, null]]', '{{}}', 'moved')": set(),
    "refresh_belief('{{{mug}}}')": WRITERS,
    "refresh_beliefs()": WRITERS,
    "robot_wastes_turn()": WRITERS,
    "weigh_experience('{{}}')": set(),
    "refresh_object_type('{{{mug}}}')": set(),
    "refresh_world('{{{mug}}}')": set(),
    "refresh_section('{{{mug}}}')": set(),
    "reshape('{{{mug}}}')": set(),
    "settle()": {*ROLES} - {"stranger"},
    "turn_to({mug}, 1, 'POINT(0 0)', 'POINT(1 0)')": {"admin"},
}
"""Each function of the schema that can write, with the roles that may call it so."""

OF_SCHEMA = "pronamespace = 'semmap'::regnamespace AND provolatile = 'v'"

FILES = (
    "^lo_|^lo(read|write)|file|_dir$|_ls_|dir$|import|export|backup|_slot|_wal|large"
    "|emit|sleep|notify|advisory_(xact_)?lock|rotate|reset|summarize|pending_list|promote|restore_point"
)
"""Names of the server's functions for files, large objects, backups and replication, and of those
that write, sleep, notify or lock."""

VALUES = {
    "text": "'PG_VERSION'",
    "name": "'x'",
    "oid": "{large}",
    "integer": "1",
    "bigint": "1",
    "boolean": "false",
    "bytea": r"'\x00'",
    "pg_lsn": "'0/0'",
    "regnamespace": "'semmap'",
    "regclass": "'semmap.entity'",
    "text[]": "'{{}}'",
    "double precision": "0",
    "interval": "'0 s'",
    "timestamp with time zone": "now()",
    "integer[]": "'{{}}'",
}

HARMLESS = {
    # the numbers of files of the log, not their content
    "pg_current_wal_lsn",
    "pg_current_wal_insert_lsn",
    "pg_current_wal_flush_lsn",
    "pg_last_wal_receive_lsn",
    "pg_last_wal_replay_lsn",
    "pg_get_wal_resource_managers",
}
"""What each role may call."""

NOT_NOW = {
    "55000": "object_not_in_prerequisite_state: the server is not a standby, or does not upgrade",
    "25001": "active_sql_transaction: a snapshot, whose file goes with its transaction",
    "55P02": "cant_change_runtime_param: the server does not run for pg_upgrade",
    "42704": "undefined_object: lo_open, which is denied, makes the descriptors of large objects",
    "42809": "wrong_object_type: they clean indexes of two kinds, for their owner, and it has none",
    "0A000": "feature_not_supported: it works while an extension is created",
}
"""Refused to everybody, the superuser included."""

STATEMENTS: dict[str, set[str]] = {
    "COPY semmap.entity TO '/tmp/semmap-never'": set(),
    "COPY semmap.entity TO PROGRAM 'true'": set(),
    "COPY semmap.map (name) FROM '/etc/hostname'": set(),
    "COPY semmap.map (name) FROM PROGRAM 'true'": set(),
    "CREATE EXTENSION file_fdw": set(),
    "CREATE EXTENSION hstore": set(),
    "CREATE FUNCTION public.f() RETURNS int LANGUAGE sql AS 'SELECT 1'": set(),
    "CREATE FUNCTION semmap.f() RETURNS int LANGUAGE sql AS 'SELECT 1'": set(),
    "CREATE SCHEMA mine": set(),
    "CREATE TABLE public.mine (id int)": set(),
    "CREATE TABLE semmap.mine (id int)": set(),
    "CREATE TRIGGER t BEFORE INSERT ON semmap.change EXECUTE FUNCTION semmap.announce()": set(),
    "CREATE RULE r AS ON INSERT TO semmap.change DO INSTEAD NOTHING": set(),
    "CREATE ROLE mine": set(),
    "CREATE TEMPORARY TABLE mine (id int)": WRITERS,
    "ALTER TABLE semmap.placement DISABLE TRIGGER ALL": set(),
    "ALTER TABLE semmap.mission DISABLE ROW LEVEL SECURITY": set(),
    "ALTER FUNCTION semmap.record_change(text, bigint[]) SECURITY INVOKER": set(),
    "ALTER ROLE semmap_admin SUPERUSER": set(),
    "GRANT semmap_admin TO CURRENT_USER": set(),
    "ALTER DEFAULT PRIVILEGES FOR ROLE semmap GRANT ALL ON TABLES TO PUBLIC": set(),
    "SET LOCAL ROLE semmap": set(),
    "SET LOCAL ROLE pg_read_server_files": set(),
    "SET LOCAL session_replication_role = replica": set(),
    "SET LOCAL zero_damaged_pages = on": set(),
    "LOCK TABLE semmap.placement IN SHARE MODE": {"admin"},
    "LOAD 'plpgsql'": set(),
    "SELECT pg_terminate_backend(0)": set(),
    "SELECT pg_cancel_backend(0)": set(),
    "SELECT pg_reload_conf()": set(),
    "SELECT pg_notify('semmap', '{{}}')": WRITERS,
    "SELECT pg_advisory_xact_lock(1)": WRITERS,
    "SELECT setval('semmap.entity_id_seq', 1)": set(),
}
"""Other ways to files, to the building of the schema and to the rights of others."""


@pytest.fixture(scope="module")
def server(module_engine: Engine) -> Iterator[tuple[Connection, dict[str, Any]]]:
    """A superuser's connection, and the ids of a scene with two robots and a large object."""
    reader = as_reader(module_engine)
    if reader is None:
        pytest.skip("these are the rights on an embedded database")
    reader.dispose()
    with Session(module_engine) as session:
        session.execute(text(f"CREATE ROLE {STRANGER}"))
        ids = dict(scene(session, OWN, OTHER))
        session.execute(
            text(
                "INSERT INTO semmap.gis_room (map, name, geom) SELECT name, 'far', "
                "ST_Multi(ST_MakeEnvelope(500, 0, 503, 3)) FROM semmap.map WHERE id = :map"
            ),
            {"map": ids["map"]},
        )
        ids["large"] = session.execute(text("SELECT lo_from_bytea(0, 'secret')")).scalar_one()
        yield session.connection(), ids
        session.rollback()


def outcome(connection: Connection, role: str, statement: str) -> str:
    """The error code of a statement of a role, or "" if it succeeds; it is undone."""
    step = connection.begin_nested()
    connection.exec_driver_sql(f"SET LOCAL SESSION AUTHORIZATION {role}")
    try:
        done = connection.execute(text(statement.replace(":", r"\:")))
        return "" if not done.returns_rows or done.all() else "no row"
    except DBAPIError as error:
        code = getattr(error.orig, "sqlstate", None)
        return str(code)  # "None" where the server did not answer
    finally:
        step.rollback()


def may(connection: Connection, statement: str) -> set[str]:
    """The roles that may execute a statement."""
    codes = {name: outcome(connection, role, statement) for name, role in ROLES.items()}
    assert set(codes.values()) <= {"", DENIED}, (statement, codes)
    return {name for name, code in codes.items() if not code}


def test_each_role_calls_each_function_that_writes(
    server: tuple[Connection, dict[str, Any]],
) -> None:
    connection, ids = server
    names = connection.execute(
        text(f"SELECT proname FROM pg_proc WHERE {OF_SCHEMA} AND prorettype <> 'trigger'::regtype")
    )
    assert {call.partition("(")[0] for call in CALLS} == set(names.scalars())
    found = {call: may(connection, f"SELECT semmap.{call.format(**ids)}") for call in CALLS}
    assert found == CALLS


def test_nobody_calls_a_trigger_function(server: tuple[Connection, dict[str, Any]]) -> None:
    connection, _ = server
    names = connection.execute(
        text(
            "SELECT proname FROM pg_proc WHERE pronamespace = 'semmap'::regnamespace "
            "AND prorettype = 'trigger'::regtype"
        )
    )
    found = {name: may(connection, f"SELECT semmap.{name}()") for name in names.scalars()}
    assert len(found) > 15
    assert {name: roles for name, roles in found.items() if roles} == {}


def test_other_functions_call_none_that_writes(
    server: tuple[Connection, dict[str, Any]],
) -> None:
    """The server lets no function write that is stable or immutable, except through others."""
    connection, _ = server
    calls = text(
        "WITH writer AS (SELECT proname FROM pg_proc "
        f"WHERE {OF_SCHEMA} AND prorettype <> 'trigger'::regtype) "
        "SELECT p.proname, w.proname FROM pg_proc p JOIN writer w "
        "ON regexp_replace(coalesce(pg_get_function_sqlbody(p.oid), p.prosrc), "
        r"'--[^\n]*', '', 'g') "
        r"~ ('\m' || w.proname || '\(') "
        "WHERE pronamespace = 'semmap'::regnamespace AND provolatile <> 'v'"
    )
    assert connection.execute(calls).all() == []
    owners = text(
        "SELECT oid::regprocedure::text FROM pg_proc WHERE prosecdef "
        "AND (pronamespace <> 'semmap'::regnamespace OR provolatile <> 'v') "
        "AND proname <> 'st_estimatedextent'"  # PostGIS: it reads statistics
    )
    assert connection.execute(owners).all() == []


def test_no_role_reaches_files_or_large_objects_and_a_reader_no_locks(
    server: tuple[Connection, dict[str, Any]],
) -> None:
    connection, ids = server
    rows = connection.execute(
        text(
            "SELECT proname, proargtypes::regtype[]::text[], provariadic <> 0 FROM pg_proc "
            "WHERE pronamespace <> 'semmap'::regnamespace AND proname ~ :files "
            "AND provolatile = 'v' AND prorettype <> 'trigger'::regtype "
            "AND prokind = 'f'"
        ),
        {"files": FILES},
    ).all()
    assert len(rows) > 60
    allowed: dict[str, set[str]] = {}
    for name, types, variadic in rows:
        values = [f"{VALUES[of].format(**ids)}::{of}" for of in types]
        if variadic:
            values[-1] = f"VARIADIC {values[-1]}"
        arguments = ", ".join(values)
        for role, login in ROLES.items():
            code = outcome(connection, login, f"SELECT pg_catalog.{name}({arguments})")
            if code == DENIED or code in NOT_NOW:
                continue
            allowed.setdefault(f"{name}: {code}" if code else name, set()).add(role)
    expected = {name: set(ROLES) for name in HARMLESS}
    assert allowed == expected | dict.fromkeys(FOR_WRITERS, WRITERS)


@pytest.mark.parametrize("statement", STATEMENTS)
def test_other_ways_are_closed(server: tuple[Connection, dict[str, Any]], statement: str) -> None:
    connection, ids = server
    assert may(connection, statement.format(**ids)) == STATEMENTS[statement]


def test_a_reader_writes_one_message_a_transaction(module_engine: Engine) -> None:
    reader = as_reader(module_engine)
    if reader is None:
        pytest.skip("these are the rights on an embedded database")
    written = text("SELECT pg_current_wal_insert_lsn() - '0/0'::pg_lsn")
    with module_engine.connect() as owner, reader.connect() as connection:
        before = owner.execute(written).scalar_one()
        calls = text("SELECT count(semmap.settle()) FROM generate_series(1, 100000)")
        assert connection.execute(calls).scalar_one() == 100_000
        connection.commit()
        assert 0 < owner.execute(written).scalar_one() - before < 1_000_000
    reader.dispose()


def test_names_of_files_are_recognised() -> None:
    for name in (
        "lo_import",
        "pg_read_file",
        "pg_ls_dir",
        "pg_stat_file",
        "lowrite",
        "pg_switch_wal",
    ):
        assert re.search(FILES, name)


DOCS = Path(__file__).parents[2] / "docs" / "promises.md"
WRITES = ("insert", "update", "delete", "truncate")


def writable(connection: Connection, role: str) -> dict[str, str]:
    """What a role may do with each table, view and sequence outside the server's own schemas."""
    rights = ", ".join(
        f"CASE WHEN has_table_privilege(:role, c.oid, '{write}') THEN '{write}'"
        + (
            f" WHEN has_any_column_privilege(:role, c.oid, '{write}') THEN '{write} some columns'"
            if write in ("insert", "update")
            else ""
        )
        + " END"
        for write in WRITES
    )
    rows = connection.execute(
        text(
            f"SELECT CASE c.relkind WHEN 'S' THEN 'sequences' ELSE c.relname END, "
            f"array_to_string(ARRAY[{rights}], ', ') FROM pg_class c "
            "WHERE c.relkind IN ('r', 'v', 'm', 'p', 'f', 'S') AND c.relnamespace NOT IN "
            "('pg_catalog'::regnamespace, 'information_schema'::regnamespace) "
            "AND c.relnamespace::regnamespace::text !~ '^pg_toast|^pg_temp' ORDER BY 1"
        ),
        {"role": role},
    )
    return {name: str(found) for name, found in rows}


def rights_table(connection: Connection) -> str:
    """The tables by the rights of robots and admins, as a table in Markdown."""
    robot, admin = (writable(connection, role) for role in (OWN, "semmap_admin"))
    groups: dict[tuple[str, str], list[str]] = {}
    for name in robot:
        if robot[name] or admin[name]:
            groups.setdefault((robot[name], admin[name]), []).append(f"`{name}`")
    lines = ["| tables and views | a robot | an admin |", "|---|---|---|"]
    lines += [
        f"| {', '.join(names)} | {mine or '-'} | {theirs or '-'} |"
        for (mine, theirs), names in sorted(groups.items())
    ]
    return "\n".join(lines) + "\n"


def test_the_documentation_says_who_writes_what(
    server: tuple[Connection, dict[str, Any]],
) -> None:
    connection, _ = server
    text = DOCS.read_text("utf-8")
    written = text.split("<!-- rights -->\n")[1].split("<!-- end -->")[0]
    assert written == rights_table(connection)
    for roles, cells in ((WRITERS, "yes | yes"), ({"admin"}, "- | yes")):
        names = {call.partition("(")[0] for call, may_call in CALLS.items() if may_call == roles}
        if roles == {"admin"}:
            names -= {call.partition("(")[0] for call in CALLS if CALLS[call] == WRITERS}
        assert f"| {', '.join(f'`{name}`' for name in sorted(names))} | {cells} |" in text


@pytest.mark.parametrize("role", ["stranger", "reader", "login"])
def test_a_reader_writes_no_table(server: tuple[Connection, dict[str, Any]], role: str) -> None:
    connection, _ = server
    assert set(writable(connection, ROLES[role]).values()) == {""}
