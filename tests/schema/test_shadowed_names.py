"""Nobody stands in for the tables, functions, operators and types that the schema's code names.

A session chooses its search path and makes temporary tables. The code that policies, triggers,
constraints, defaults, indexes and views call must not see them: its names are bound when it is
made, or its search path is fixed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import psycopg
import pytest
from sqlalchemy import Engine, text
from sqlalchemy.orm import Session

from tests.schema.test_roles import READ, RIGHTS, STATEMENTS, scene

PATH = "search_path=semmap, public, pg_temp"

REACHED = """
WITH RECURSIVE start (proc) AS (
    SELECT DISTINCT d.refobjid FROM pg_depend d
    LEFT JOIN pg_rewrite r ON d.classid = 'pg_rewrite'::regclass AND r.oid = d.objid
    LEFT JOIN pg_class c ON c.oid = r.ev_class
         OR d.classid = 'pg_class'::regclass AND c.oid = d.objid
    LEFT JOIN pg_policy p ON d.classid = 'pg_policy'::regclass AND p.oid = d.objid
    LEFT JOIN pg_trigger t ON d.classid = 'pg_trigger'::regclass AND t.oid = d.objid
    LEFT JOIN pg_constraint k ON d.classid = 'pg_constraint'::regclass AND k.oid = d.objid
    LEFT JOIN pg_attrdef a ON d.classid = 'pg_attrdef'::regclass AND a.oid = d.objid
    JOIN pg_class o ON o.oid = coalesce(c.oid, p.polrelid, t.tgrelid, k.conrelid, a.adrelid)
    WHERE d.refclassid = 'pg_proc'::regclass AND o.relnamespace = 'semmap'::regnamespace
), names (proc, code) AS (
    SELECT oid, regexp_replace(coalesce(pg_get_function_sqlbody(oid), prosrc), '--[^\\n]*', '', 'g')
    FROM pg_proc WHERE pronamespace = 'semmap'::regnamespace
), reached (proc) AS (
    SELECT proc FROM start
  UNION
    SELECT f.proc FROM reached r JOIN names n USING (proc), LATERAL (
        SELECT oid FROM pg_proc
        WHERE pronamespace = 'semmap'::regnamespace AND n.code ~ ('\\m' || proname || '\\(')
      UNION ALL
        SELECT refobjid FROM pg_depend  -- of a body whose names are bound
        WHERE classid = 'pg_proc'::regclass AND objid = r.proc
          AND refclassid = 'pg_proc'::regclass) f (proc))
SELECT p.oid::regprocedure::text, p.pronamespace::regnamespace::text, l.lanname,
       p.prosqlbody IS NOT NULL, coalesce(p.proconfig, '{}')
FROM reached r JOIN pg_proc p ON p.oid = r.proc JOIN pg_language l ON l.oid = p.prolang
"""
"""The functions that a policy, trigger, constraint, default, index or view reaches."""


def test_each_function_that_is_reached_has_bound_names_or_a_fixed_path(
    module_engine: Engine,
) -> None:
    with module_engine.connect() as connection:
        rows = connection.execute(text(REACHED)).all()
        ours = connection.scalar(
            text("SELECT count(*) FROM pg_proc WHERE pronamespace = 'semmap'::regnamespace")
        )
    reached = [row for row in rows if row[1] == "semmap"]
    assert len(reached) > ours / 2
    loose = [name for name, _, _, bound, settings in reached if not bound and PATH not in settings]
    assert loose == []


def test_functions_of_postgis_that_are_reached_read_no_table_without_its_schema(
    module_engine: Engine,
) -> None:
    """Who may make no schema can shadow tables and types alone."""
    with module_engine.connect() as connection:
        reached = connection.execute(text(REACHED)).all()
        foreign = [
            n for n, schema, language, *_ in reached if schema == "public" and language != "c"
        ]
        read = connection.execute(
            text(
                "SELECT oid::regprocedure::text FROM pg_proc "
                "WHERE oid::regprocedure::text = ANY (:names) "
                r"AND prosrc ~* '\m(FROM|JOIN|INTO|UPDATE)\s+[a-z_]+\M(?!\s*[.(])'"
            ),
            {"names": foreign},
        ).scalars()
        assert read.all() == []


def test_no_function_of_the_schema_is_left_out(module_engine: Engine) -> None:
    statement = (
        "SELECT oid::regprocedure::text FROM pg_proc WHERE pronamespace = 'semmap'::regnamespace "
        "AND prosqlbody IS NULL AND NOT coalesce(proconfig, '{}') @> ARRAY[:path]"
    )
    with module_engine.connect() as connection:
        assert connection.execute(text(statement), {"path": PATH}).scalars().all() == []


MENTIONED = r"""
WITH body AS (
    SELECT regexp_replace(coalesce(pg_get_function_sqlbody(oid), prosrc), '--[^\n]*', '', 'g')
    FROM pg_proc WHERE pronamespace = 'semmap'::regnamespace
), word AS (
    SELECT DISTINCT lower(m[1]) AS word FROM body b (code), regexp_matches(b.code, '\w+', 'g') m)
"""

RELATIONS = (
    MENTIONED
    + "SELECT relnamespace::regnamespace::text, relname FROM pg_class JOIN word ON word = relname "
    "WHERE relnamespace IN ('semmap'::regnamespace, 'pg_catalog'::regnamespace) "
    "AND relkind IN ('r', 'v') ORDER BY 1, 2"
)
FUNCTIONS = (
    MENTIONED
    + "SELECT p.proname, pg_get_function_identity_arguments(p.oid), pg_get_function_result(p.oid) "
    "FROM pg_proc p JOIN word ON word = proname WHERE p.prokind = 'f' "
    "AND p.prorettype NOT IN ('trigger'::regtype, 'internal'::regtype, 'event_trigger'::regtype) "
    "AND p.pronamespace::regnamespace::text IN ('semmap', 'pg_catalog', 'public')"
)
TYPES = (
    MENTIONED
    + "SELECT typname, typnamespace::regnamespace::text FROM pg_type JOIN word ON word = typname "
    "WHERE typtype = 'b' AND typnamespace IN ('pg_catalog'::regnamespace, 'public'::regnamespace)"
)
OPERATORS = (
    "SELECT oprname, format_type(oprleft, NULL), format_type(oprright, NULL), "
    "format_type(oprresult, NULL) FROM pg_operator "
    "WHERE oprleft <> 0 AND oprnamespace IN ('pg_catalog'::regnamespace, 'public'::regnamespace) "
    "AND NOT concat(oprleft::regtype, ' ', oprright::regtype) ~ '\\m(any|internal)'"
)

Robot = tuple[psycopg.Connection[Any], dict[str, int], str]


@pytest.fixture(scope="module")
def robot(make_database: Any) -> Iterator[Robot]:
    """A robot that may make schemas, whose session shadows each name that the code mentions.

    Each statement of the table of rights is a function `attack.s<number>` whose names are bound,
    so that only the schema's own code can meet the shadows.
    """
    from semmap.database import open_engine

    engine = open_engine(make_database())
    own, other = f"shadow_{os.getpid()}", f"victim_{os.getpid()}"
    with Session(engine) as session:
        ids = scene(session, own, other)
        session.execute(text("CREATE SCHEMA attack"))
        session.execute(text(f"GRANT USAGE ON SCHEMA attack TO {own}"))
        for number, statement in enumerate(STATEMENTS):
            for part, code in enumerate(statement.format(**ids).split("; ")):
                if code.startswith(("CREATE", "WITH made")):
                    continue
                returned = code if code.startswith("SELECT") else f"{code} RETURNING 1"
                wrapped = f"{returned}; SELECT 1;" if " FROM chunk" in code else f"{returned};"
                if code.startswith("SELECT"):
                    wrapped = f"SELECT 1 FROM ({code}) given;"
                session.execute(
                    text(
                        f"CREATE FUNCTION attack.s{number}_{part}() RETURNS SETOF integer "
                        f"LANGUAGE sql VOLATILE BEGIN ATOMIC {wrapped} END".replace(":", "\\:")
                    )
                )
        session.execute(text(f"GRANT CREATE ON DATABASE {engine.url.database} TO {own}"))
        session.commit()
    url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f"SET SESSION AUTHORIZATION {own}")
        shadow(connection, own)
        yield connection, ids, own
    with engine.begin() as owner:
        owner.execute(text("DROP SCHEMA attack, trap CASCADE"))
        for name in (own, other):
            owner.execute(text(f"DROP OWNED BY {name}"))
            owner.execute(text(f"DROP ROLE {name}"))
    engine.dispose()


def shadow(connection: psycopg.Connection[Any], own: str) -> None:
    """Shadow all relations, types, functions and operators that the schema's code mentions."""
    relations = connection.execute(RELATIONS).fetchall()
    functions = connection.execute(FUNCTIONS).fetchall()
    types = connection.execute(TYPES).fetchall()
    operators = connection.execute(OPERATORS).fetchall()
    assert len(relations) > 50
    assert len(functions) > 300
    assert len(operators) > 500
    connection.execute("CREATE SCHEMA trap")
    connection.execute("SET check_function_bodies = off")
    body = "LANGUAGE plpgsql AS $$ BEGIN RAISE EXCEPTION 'shadowed'; END $$"
    for name, arguments, result in functions:
        attempt(connection, f'CREATE FUNCTION trap."{name}"({arguments}) RETURNS {result} {body}')
    for number, (name, left, right, result) in enumerate(operators):
        attempt(
            connection, f"CREATE FUNCTION trap.o{number}({left}, {right}) RETURNS {result} {body}"
        )
        attempt(
            connection,
            f"CREATE OPERATOR trap.{name} "
            f"(FUNCTION = trap.o{number}, LEFTARG = {left}, RIGHTARG = {right})",
        )
    for schema, name in relations:
        connection.execute(f"CREATE TEMP TABLE {name} AS SELECT * FROM {schema}.{name} WHERE false")
    for name, schema in types:
        attempt(connection, f'CREATE DOMAIN pg_temp."{name}" AS {schema}."{name}" CHECK (false)')
    connection.execute(
        f"INSERT INTO pg_temp.pg_roles (oid, rolname) SELECT (SELECT oid FROM pg_catalog.pg_roles "
        f"WHERE rolname = '{own}'), rolname FROM pg_catalog.pg_roles"
    )
    connection.execute(
        "INSERT INTO pg_temp.pg_class (oid, relname, relowner) "
        "SELECT c.oid, c.relname, r.oid FROM pg_catalog.pg_class c, pg_catalog.pg_roles r "
        f"WHERE r.rolname = '{own}'"
    )
    connection.execute("SET search_path = pg_temp, trap, pg_catalog, semmap, public")


def attempt(connection: psycopg.Connection[Any], statement: str) -> None:
    """Make a shadow, where PostgreSQL lets a user make it."""
    with suppress(psycopg.errors.ProgrammingError, psycopg.errors.NotSupportedError):
        connection.execute(statement)


def test_the_shadows_are_met_by_a_session_of_its_own(robot: Robot) -> None:
    connection, _, _ = robot
    with pytest.raises(psycopg.errors.RaiseException, match="shadowed"):
        connection.execute("SELECT 1 = 2")
    with pytest.raises(psycopg.errors.CheckViolation):
        connection.execute("SELECT 10::oid")
    assert connection.execute("SELECT oid, relname FROM pg_class LIMIT 1").fetchall()
    assert connection.execute("SELECT id FROM entity").fetchall() == []


NAMING = [n for n, statement in enumerate(STATEMENTS) if not statement.startswith("CREATE")]
"""Those with names that could be shadowed: all but the one that makes a table."""


@pytest.mark.parametrize("number", NAMING)
def test_shadows_give_no_rights(robot: Robot, number: int) -> None:
    connection, ids, _ = robot
    statement = STATEMENTS[number]
    parts = statement.format(**ids).split("; ")
    allowed = True
    connection.execute("BEGIN")
    try:
        for part in range(len(parts)):
            cursor = connection.execute(f"SELECT * FROM attack.s{number}_{part}()")
            allowed = allowed and cursor.rowcount > 0
        connection.execute("SET CONSTRAINTS ALL IMMEDIATE")
    except psycopg.errors.InsufficientPrivilege:
        allowed = False
    finally:
        connection.execute("ROLLBACK")
    assert allowed == (statement in RIGHTS["semmap_robot"])


def test_a_shadowed_catalogue_does_not_give_a_mesh_the_digest_of_an_import(robot: Robot) -> None:
    connection, _, own = robot
    connection.execute("BEGIN")
    connection.execute(
        "INSERT INTO semmap.model (digest, kind, triangles, hull) VALUES ('abc', 'mesh', 0, "
        "public.ST_GeomFromText('MULTIPOINT Z (0 0 0)'::pg_catalog.text))"
    )
    rows = connection.execute("SELECT digest FROM semmap.model").fetchall()
    connection.execute("ROLLBACK")
    assert (f"{own}/abc",) in rows
    assert ("abc",) not in rows


def test_reading_is_not_deceived(robot: Robot) -> None:
    connection, ids, _ = robot
    assert READ in RIGHTS["semmap_robot"]
    rows = connection.execute(
        "SELECT semmap.is_own_robot(%s), semmap.is_other_robot(%s)", (ids["other"], ids["other"])
    ).fetchall()
    assert rows == [(False, True)]
