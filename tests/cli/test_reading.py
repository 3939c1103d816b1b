"""`semmap sql` without --write only reads, whatever the statement: a table of ways out.

The database is an embedded one, whose owner is a superuser.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psycopg
import pytest
from sqlalchemy import URL, Engine
from sqlalchemy.exc import DBAPIError

from semmap.query.sql_statement import READING
from tests.command_line import semmap

SECRET = "what only the server's user can read"


def regained(query: str) -> str:
    """A statement that leaves its role, then runs a query."""
    quoted = query.replace("'", "''")
    return f"SELECT set_config('role', 'none', true), query_to_xml('{quoted}', true, true, '')"


def do(*statements: str) -> str:
    """A block that leaves its role, then runs statements."""
    return f"DO $$ BEGIN RESET ROLE; {' '.join(f'{s};' for s in statements)} END $$"


WAYS_OUT = {
    "a block runs a program": do("COPY (SELECT 1) TO PROGRAM 'touch {file}'"),
    "a block writes a file": do("COPY (SELECT 1) TO '{file}'"),
    "a block reads a file": do("RAISE EXCEPTION '%', pg_read_file('{secret}')"),
    "a block makes a large object": do("PERFORM lo_create(0)"),
    "a block ends a session": do("PERFORM pg_terminate_backend({session})"),
    "a block loads the settings": do("PERFORM pg_reload_conf()"),
    "a block announces": do("NOTIFY semmap, 'x'"),
    "a function reads a file": regained("SELECT pg_read_file('{secret}')"),
    "a function reads bytes": regained("SELECT pg_read_binary_file('{secret}')::text"),
    "a function lists a folder": regained("SELECT pg_ls_dir('{folder}')"),
    "a function looks at a file": regained("SELECT pg_stat_file('{secret}')::text"),
    "a function imports a file": regained("SELECT lo_import('{secret}')"),
    "a function ends a session": regained("SELECT pg_terminate_backend({session})"),
    "a function cancels a query": regained("SELECT pg_cancel_backend({session})"),
    "a function loads the settings": regained("SELECT pg_reload_conf()"),
    "a function reads passwords": regained("SELECT rolpassword FROM pg_authid"),
    "the owner's role": "SELECT set_config('role', 'semmap', false)",
    "the owner's session": "SELECT set_config('session_authorization', 'semmap', false)",
    "SET SESSION AUTHORIZATION": "SET SESSION AUTHORIZATION DEFAULT",
    "SET ROLE": "SET ROLE semmap",
    "RESET ROLE": "RESET ROLE",
    "SET": "SET work_mem = '1GB'",
    "lo_creat": "SELECT lo_creat(-1)",
    "lo_create": "SELECT lo_create(0)",
    "lo_from_bytea": "SELECT lo_from_bytea(0, 'x')",
    "pg_notify": "SELECT pg_notify('semmap', 'x')",
    "NOTIFY": "NOTIFY semmap, 'x'",
    "LISTEN": "LISTEN semmap",
    "pg_advisory_lock": "SELECT pg_advisory_lock(126879278428528)",
    "pg_advisory_xact_lock": "SELECT pg_advisory_xact_lock(1)",
    "pg_try_advisory_lock": "SELECT pg_try_advisory_lock(1, 2)",
    "PREPARE": "PREPARE x AS SELECT 1",
    "DECLARE": "DECLARE x CURSOR WITH HOLD FOR SELECT 1",
    "SAVEPOINT": "SAVEPOINT x",
    "COMMIT": "COMMIT",
    "LOCK": "LOCK TABLE semmap.map IN ACCESS SHARE MODE",
    "DISCARD": "DISCARD PLANS",
    "a temporary table explained": "EXPLAIN ANALYZE CREATE TEMP TABLE x AS SELECT 1",
    "after a comment": "/* SELECT /* */ */ -- SELECT\r SET work_mem = '1GB'",
}
"""Each of these did what it says, or was run at least, while the reader was a superuser's role."""

CLOSED_BEFORE = {
    "COPY TO PROGRAM": "COPY (SELECT 1) TO PROGRAM 'touch {file}'",
    "COPY TO a file": "COPY (SELECT 1) TO '{file}'",
    "pg_read_file": "SELECT pg_read_file('{secret}')",
    "pg_ls_dir": "SELECT pg_ls_dir('{folder}')",
    "lo_import": "SELECT lo_import('{secret}')",
    "lo_export": "SELECT lo_export({large_object}, '{file}')",
    "pg_reload_conf": "SELECT pg_reload_conf()",
    "pg_terminate_backend": "SELECT pg_terminate_backend({session})",
    "pg_cancel_backend": "SELECT pg_cancel_backend({session})",
    "nextval": "SELECT nextval('semmap.entity_id_seq')",
    "setval": "SELECT setval('semmap.entity_id_seq', 1000)",
    "a temporary table": "CREATE TEMP TABLE x (id int)",
    "a temporary table from a query": "SELECT 1 AS x INTO TEMP x",
    "lo_put": "SELECT lo_put({large_object}, 0, 'y')",
    "lo_open, lowrite": "SELECT lowrite(lo_open({large_object}, 131072), 'y')",
    "lo_unlink": "SELECT lo_unlink({large_object})",
    "CALL": "CALL x()",
    "SET TRANSACTION": "SET TRANSACTION READ WRITE",
    "a table explained": "EXPLAIN ANALYZE CREATE TABLE x AS SELECT 1",
    "WITH DELETE": "WITH x AS (DELETE FROM map RETURNING id) SELECT id FROM x",
    "EXPLAIN ANALYZE INSERT": "EXPLAIN ANALYZE INSERT INTO map (name) VALUES ('x')",
    "FOR UPDATE": "SELECT * FROM map FOR UPDATE",
    "read-write": "SELECT set_config('transaction_read_only', 'off', false)",
    "two statements": "SELECT 1; DELETE FROM map",
    "two transactions": "COMMIT; DELETE FROM map",
}


@dataclass
class Scene:
    """A database with what a statement may reach for.

    Attributes
    ----------
    session : another session of whoever may run the statement
    listener : hears what is announced
    """

    url: str
    secret: Path
    file: Path
    large_object: int
    session: psycopg.Connection[Any]
    listener: psycopg.Connection[Any]

    def fill(self, statement: str) -> str:
        names = {
            "secret": self.secret,
            "file": self.file,
            "folder": self.secret.parent,
            "session": self.session.info.backend_pid,
            "large_object": self.large_object,
        }
        for name, value in names.items():
            statement = statement.replace(f"{{{name}}}", str(value))
        return statement

    def state(self) -> list[Any]:
        """What a statement that only reads leaves as it is."""
        asked = (
            "SELECT array_agg((m.oid, data)::text) FROM pg_largeobject_metadata m "
            "LEFT JOIN pg_largeobject ON loid = m.oid",
            "SELECT count(*) FROM pg_locks WHERE locktype = 'advisory'",
            "SELECT count(*) FROM pg_class WHERE relpersistence = 't'",
            "SELECT (last_value, is_called)::text FROM semmap.entity_id_seq",
            "SELECT array_agg(name) FROM semmap.map",
            "SELECT pg_conf_load_time()::text",
            "SELECT array_agg((rolname, rolsuper, rolconfig)::text ORDER BY oid) FROM pg_roles",
        )
        found = [self.listener.execute(statement).fetchone() for statement in asked]  # type: ignore[call-overload]
        heard = [notice.payload for notice in self.listener.notifies(timeout=0)]
        alive = self.session.execute("SELECT 1").fetchone()
        return [*found, heard, alive, self.file.exists()]


def as_login(address: URL, login: str) -> str:
    return address.set(username=login).render_as_string(hide_password=False)


@pytest.fixture(scope="module")
def scene(module_engine: Engine, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    url = module_engine.url.render_as_string(hide_password=False)
    with module_engine.connect() as connection:
        data = Path(connection.exec_driver_sql("SHOW data_directory").scalar_one())
    folder = data / "secrets"
    folder.mkdir()
    secret = folder / "secret"
    secret.write_text(SECRET)
    for path in (folder, secret):
        os.chown(path, data.stat().st_uid, data.stat().st_gid)
    with module_engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO map (name) VALUES ('kept')")
        large = connection.exec_driver_sql("SELECT lo_from_bytea(0, 'kept')").scalar()
    assert semmap(url, "sql", "SELECT 1").exit_code == 0  # the reader's login is there
    address = module_engine.url.set(
        drivername="postgresql",
        query={key: module_engine.url.query[key] for key in ("host", "port")},
    )
    with (
        closing(psycopg.connect(as_login(address, "semmap_read"), autocommit=True)) as other,
        closing(psycopg.connect(as_login(address, "semmap"), autocommit=True)) as listener,
    ):
        listener.execute("LISTEN semmap")
        yield Scene(url, secret, folder / "written", large, other, listener)
    secret.unlink()
    folder.rmdir()


@pytest.mark.parametrize("way", [*WAYS_OUT, *CLOSED_BEFORE])
def test_a_statement_that_reads_does_nothing_else(scene: Scene, way: str) -> None:
    statement = scene.fill((WAYS_OUT | CLOSED_BEFORE)[way])
    before = scene.state()
    try:
        result = semmap(scene.url, "sql", statement)
    except (ValueError, DBAPIError, psycopg.Error) as error:
        said = str(error)
    else:
        pytest.fail(f"it was run, and said {result.output}")
    assert SECRET not in said
    assert scene.state() == before


@pytest.mark.parametrize("way", [w for w, said in WAYS_OUT.items() if said[:2] in ("DO", "SE")])
def test_the_login_is_enough(scene: Scene, way: str) -> None:
    """Also where a statement is not looked at before it is run."""
    before = scene.state()
    try:
        with scene.session.transaction(force_rollback=True):
            scene.session.execute("SET TRANSACTION READ ONLY")
            done = scene.session.execute(scene.fill(WAYS_OUT[way]))  # type: ignore[call-overload]
            said = str(done.fetchall() if done.description else "")
    except psycopg.Error as error:
        said = str(error)
    assert SECRET not in said
    scene.session.execute("RESET ALL")
    assert scene.state() == before


@pytest.mark.parametrize(
    "change",
    [
        "NOTIFY semmap, 'x'",
        "SELECT pg_reload_conf()",
        "SELECT nextval('semmap.entity_id_seq')",
        "SELECT lo_create(0)",
        "SELECT pg_advisory_lock(1)",
        "INSERT INTO semmap.map (name) VALUES ('x')",
        "CREATE TEMP TABLE x (id int)",
        "ALTER ROLE semmap_robot SET work_mem = '1MB'",
    ],
)
def test_a_change_would_be_seen(scene: Scene, change: str) -> None:
    before = scene.state()
    scene.listener.execute(change)  # type: ignore[call-overload]
    deadline = time.monotonic() + 10
    while scene.state() == before and time.monotonic() < deadline:
        time.sleep(0.05)
    if change.startswith("NOTIFY"):
        scene.listener.execute(change)  # type: ignore[call-overload]
    assert scene.state() != before


READS = {
    "SELECT 1 AS a": [{"a": 1}],
    " (select 1 AS a)": [{"a": 1}],
    ";-- SET x\n/* DO /* $$ */ */ (SELECT 1 AS a);": [{"a": 1}],
    "WITH x (a) AS (SELECT 1) SELECT a FROM x": [{"a": 1}],
    "VALUES (1), (2)": [{"column1": 1}, {"column1": 2}],
    "TABLE semmap.retention LIMIT 0": [],
    "SHOW timezone": [{"TimeZone": "UTC"}],
    "SELECT current_user, session_user": [
        {"current_user": "semmap_read", "session_user": "semmap_read"}
    ],
    "SELECT current_user FROM (SELECT set_config('role', 'none', true)) x": [
        {"current_user": "semmap_read"}
    ],
    "SELECT count(*) FROM map WHERE name = 'kept'": [{"count": 1}],
    "SELECT count(*) FROM face": [{"count": 0}],
    "SELECT pg_advisory_unlock_all() IS NULL AS a": [{"a": False}],
}


@pytest.mark.parametrize("statement", READS)
def test_statements_that_read_are_run(scene: Scene, statement: str) -> None:
    assert json.loads(semmap(scene.url, "sql", statement, "--json").stdout) == READS[statement]
    if "map" in statement:
        plan = semmap(scene.url, "sql", f"EXPLAIN ANALYZE {statement}").stdout
        assert "Execution Time" in plan


@pytest.mark.parametrize("word", ["SET", "DO", "DELETE", "LISTEN", "CREATE"])
def test_other_statements_are_refused_with_a_hint(scene: Scene, word: str) -> None:
    rest = {
        "SET": "work_mem = '1GB'",
        "DO": "'BEGIN END'",
        "DELETE": "FROM map",
        "LISTEN": "x",
        "CREATE": "TABLE x ()",
    }[word]
    with pytest.raises(ValueError, match=f"permission denied for {word}: .*Add --write") as caught:
        semmap(scene.url, "sql", f"{word} {rest}")
    assert all(reading in str(caught.value) for reading in READING)


def test_with_write_all_is_run(scene: Scene) -> None:
    said = semmap(scene.url, "sql", "--write", "SELECT current_user", "--json").stdout
    assert json.loads(said) == [{"current_user": "semmap"}]
    assert semmap(scene.url, "sql", "--write", "DO 'BEGIN END'").exit_code == 0
