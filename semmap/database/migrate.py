"""The schema's revisions: up, down, and the SQL files of `schema/` that they run.

Revisions change tables only. The code (functions, triggers, views, rights) is dropped before the
first of them, since it depends on the tables, and made by `schema/` after the last. It fits the
newest tables: a downgrade leaves the tables without code, until the semmap whose tables these are
makes its own.

Why: docs/decisions/revisions_only_append_and_change_tables_alone.md
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import psycopg
from alembic import command
from alembic.config import Config
from alembic.util import CommandError
from psycopg import sql
from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import DBAPIError

from semmap.database import revisions
from semmap.database.error import DatabaseError
from semmap.database.files import migrations_folder, schema_folder
from semmap.database.maps import driver_of
from semmap.database.requirements import check_requirements

if TYPE_CHECKING:
    from pathlib import Path

LOCK = 0x73656D6D6170  # "semmap"
"""Key of the advisory lock that whoever changes the schema holds."""

DROP_CODE = """
DO $$
DECLARE
    statement text;
BEGIN
    FOREACH statement IN ARRAY ARRAY(  -- all of them before the first is run: a drop may cascade
        SELECT format('DROP POLICY %I ON %s', polname, polrelid::regclass)
        FROM pg_policy p JOIN pg_class c ON c.oid = p.polrelid
        WHERE c.relnamespace = 'semmap'::regnamespace
        UNION ALL
        SELECT format('ALTER TABLE %s DISABLE ROW LEVEL SECURITY', oid::regclass)
        FROM pg_class WHERE relnamespace = 'semmap'::regnamespace AND relrowsecurity
        UNION ALL
        SELECT format('DROP VIEW IF EXISTS %s CASCADE', oid::regclass)
        FROM pg_class WHERE relnamespace = 'semmap'::regnamespace AND relkind = 'v'
          AND oid NOT IN (SELECT objid FROM pg_depend WHERE deptype = 'e')  -- of an extension
        UNION ALL
        SELECT format('DROP %s IF EXISTS %s CASCADE',
                      CASE prokind WHEN 'a' THEN 'AGGREGATE' ELSE 'FUNCTION' END, oid::regprocedure)
        FROM pg_proc WHERE pronamespace = 'semmap'::regnamespace
          AND oid NOT IN (SELECT objid FROM pg_depend WHERE deptype = 'e'))
    LOOP
        EXECUTE statement;
    END LOOP;
    REVOKE ALL ON ALL TABLES IN SCHEMA semmap FROM semmap_reader, semmap_robot, semmap_admin;
    REVOKE ALL ON ALL SEQUENCES IN SCHEMA semmap FROM semmap_reader, semmap_robot, semmap_admin;
    REVOKE ALL ON SCHEMA semmap FROM semmap_reader, semmap_robot, semmap_admin;
END $$
"""


def upgrade(engine: Engine, revision: str = "head") -> None:
    """Bring the schema up to a revision, in one transaction; another process waits its turn.

    DatabaseError where the server, PostGIS or the user's rights do not suffice, the database has a
    revision that this semmap does not know, or a statement failed; nothing is changed.
    """
    with _transaction(engine, "upgraded") as connection:
        check_requirements(connection)
        if revision == "head" and revisions.installed(driver_of(connection)) == revisions.newest():
            return
        _change_tables(connection, command.upgrade, revision)


def downgrade(engine: Engine, revision: str) -> None:
    """Take the schema down to a revision (``base``, ``-1``, ``0001``); all rows stay."""
    with _transaction(engine, "downgraded") as connection:
        _change_tables(connection, command.downgrade, revision)


def drop(engine: Engine) -> None:
    """Delete the schema with all maps, what downgrades put aside, and the revision."""
    with _transaction(engine, "dropped") as connection:
        for statement in (
            "DROP SCHEMA IF EXISTS semmap CASCADE",
            "DROP SCHEMA IF EXISTS semmap_kept CASCADE",
            f"DROP TABLE IF EXISTS {revisions.VERSION_SCHEMA}.{revisions.VERSION_TABLE}",
        ):
            connection.exec_driver_sql(statement)


def run_sql_files(connection: Connection, *patterns: str) -> None:
    """Execute files of `schema/`, pattern by pattern, each pattern's files in order of their paths.

    A file goes to the server as it stands, in one piece: colons, percent signs and function bodies
    mean nothing on the way. Names without a schema are those of `semmap`. DatabaseError where a
    pattern fits no file, or a statement fails: file and line are named.
    """
    connection.exec_driver_sql("SET LOCAL search_path = semmap, public")
    for pattern in patterns:
        files = sorted(schema_folder().glob(pattern))
        if not files:
            raise DatabaseError(f"{schema_folder()} has no file that fits {pattern}")
        for path in files:
            _run_sql_file(driver_of(connection), path)


def _change_tables(
    connection: Connection, run: Callable[[Config, str], None], revision: str
) -> None:
    """Run Alembic's `run` to a revision without code; make the code at the newest one."""
    _drop_code(connection)
    run(_config(connection), revision)
    if connection.scalar(text("SELECT to_regclass('semmap.kept_relation') IS NOT NULL")):
        # a revision may have changed rows, and nothing recorded it
        connection.exec_driver_sql("DELETE FROM semmap.kept_relation")
    if (revisions.installed(driver_of(connection)) or "").split(" ")[0] == revisions.newest():
        # bodies are not checked here: functions may call those of later files
        connection.exec_driver_sql("SET LOCAL check_function_bodies = off")
        run_sql_files(connection, *(p for p in revisions.CODE if any(schema_folder().glob(p))))
        if connection.scalar(text("SELECT to_regnamespace('semmap') IS NOT NULL")):
            mark = sql.Literal(revisions.code())
            driver_of(connection).execute(sql.SQL("COMMENT ON SCHEMA semmap IS {}").format(mark))


def _drop_code(connection: Connection) -> None:
    """Drop functions, triggers, views and rights; the tables and their rows stay."""
    connection.exec_driver_sql("SET LOCAL search_path = semmap, public")
    if connection.scalar(text("SELECT to_regnamespace('semmap') IS NOT NULL")):
        connection.execute(text(DROP_CODE))


def _run_sql_file(connection: psycopg.Connection, path: Path) -> None:
    script = path.read_bytes()
    try:
        connection.execute(script)
    except psycopg.Error as error:
        raise DatabaseError(f"{_place(path, script, error)}: {_message(error)}") from error


def _place(path: Path, script: bytes, error: psycopg.Error) -> str:
    name = f"{path.parent.name}/{path.name}"
    position = error.diag.statement_position
    if position is None:
        return name
    return f"{name}:{script.decode()[: int(position)].count(chr(10)) + 1}"


def _message(error: BaseException | None) -> str:
    if isinstance(error, psycopg.Error) and error.diag.message_primary:
        parts = (error.diag.message_primary, error.diag.message_detail, error.diag.message_hint)
        return ". ".join(part for part in parts if part)
    return str(error).strip()


@contextmanager
def _transaction(engine: Engine, done: str) -> Iterator[Connection]:
    """A transaction that changes the schema, alone; its errors as DatabaseError."""
    try:
        with engine.begin() as connection:
            connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({LOCK})")
            yield connection
    except CommandError as error:
        raise DatabaseError(
            f"the schema cannot be {done}: {error}. This semmap knows the revisions "
            f"{', '.join(sorted(revisions.parents()))}"
        ) from error
    except DBAPIError as error:
        if getattr(error.orig, "sqlstate", None) == "42501":  # insufficient_privilege
            raise DatabaseError(
                f"the schema cannot be {done}: {_message(error.orig)}. An administrator of this "
                "database can: semmap --db URL db upgrade"
            ) from error
        if error.connection_invalidated or getattr(error.orig, "sqlstate", None) is None:
            raise
        raise DatabaseError(f"the schema cannot be {done}: {_message(error.orig)}") from error


def _config(connection: Connection) -> Config:
    config = Config()
    config.set_main_option("script_location", str(migrations_folder()).replace("%", "%%"))
    config.attributes["connection"] = connection
    return config
