"""Statements as the command line runs them, and their answers in tables and JSON."""

from __future__ import annotations

import json
import re
from pathlib import Path

import psycopg
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from psycopg.pq import ExecStatus
from sqlalchemy import Engine

from semmap.cli.output import unique_names
from semmap.query.sql_statement import kind, run_sql
from tests.command_line import semmap
from tests.ingest.worlds_by_hand import box_world


@given(st.lists(st.sampled_from(["a", "a_2", "a_3", "b", "a_2_2"]), max_size=8))
def test_no_column_is_lost(columns: list[str]) -> None:
    names = unique_names(columns)
    assert len({*names}) == len(columns)
    for name, column in zip(names, columns, strict=True):
        assert name == column or name.startswith(f"{column}_")


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("'NaN'::float8", "NaN"),
        ("'-Infinity'::float8", "-Infinity"),
        ("1.5::numeric", 1.5),
        ("7::numeric", 7),
        ("'NaN'::numeric", "NaN"),
        ("'\\x00ff'::bytea", "\\x00ff"),
        ("'[1,)'::int4range", "[1,)"),
        ("'empty'::int4range", "empty"),
        ("'infinity'::timestamptz", "infinity"),
        ("'0044-03-15 BC'::date", "0044-03-15 BC"),
        ("'{1,NULL}'::int[]", [1, None]),
        ("""'{"a": [1]}'::jsonb""", {"a": [1]}),
        ("NULL", None),
        ("true", True),
        ("array['NaN'::float8]", ["NaN"]),
    ],
)
def test_every_value_has_a_form_in_json(database: str, said: str, expected: object) -> None:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    answer = semmap(database, "sql", f"SELECT {said} AS v", "--json").stdout
    assert json.loads(answer, parse_constant=refuse) == [{"v": expected}]


def test_brackets_and_colons_are_parts_of_names(database: str, tmp_path: Path) -> None:
    said = semmap(database, "sql", "SELECT '[/foo]' AS a, 'room:x:1 [bold]b[/bold]' AS b").stdout
    assert "[/foo]" in said
    assert "room:x:1 [bold]b[/bold]" in said
    world = box_world(tmp_path, {"shelf[/a]": (0, 0, 0.4), "cup:x:1": (3, 0, 0.4)})
    assert "boxes.sdf -> map boxes: 2 objects" in semmap(database, "import", world).stdout
    listed = semmap(database, "ls").stdout
    assert "shelf[/a]" in listed
    assert "cup:x:1" in listed
    assert "shelf[/a]" in semmap(database, "show", "shelf[/a]").stdout


@pytest.mark.parametrize("statement", ["COPY entity TO STDOUT", "COPY map (name) FROM STDIN"])
@pytest.mark.parametrize("write", [["--write"], []])
def test_copy_statements_are_refused(database: str, statement: str, write: list[str]) -> None:
    with pytest.raises((ValueError, psycopg.Error), match=r"db psql|permission denied|read-only"):
        semmap(database, "sql", statement, *write)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("ls", "--near", "nan,0,0"), "--near takes 3 numbers"),
        (("ls", "--near", "0,0,0", "--within", "nan"), "within takes metres from 0 on"),
        (("ls", "--near", "0,0,0", "--within", "-1"), "within takes metres from 0 on"),
        (("ls", "--box", "5,5,5,0,0,0"), "its lowest corner first, then its highest"),
        (("show", "crate", "--at", "yesterday"), "--at takes an ISO 8601 time"),
        (("changes", "abc"), "abc is not a cursor"),
    ],
)
def test_invalid_arguments_get_a_hint(
    database: str, tmp_path: Path, words: tuple[str, ...], says: str
) -> None:
    semmap(database, "import", box_world(tmp_path, {"crate": (0, 0, 0.4)}))
    with pytest.raises(ValueError, match=re.escape(says)):
        semmap(database, *words)


def test_an_empty_statement_is_reported(database: str) -> None:
    with pytest.raises(ValueError, match="no statement: give one, or -"):
        semmap(database, "sql", " ;\n")


def test_readers_write_no_files(engine: Engine, tmp_path: Path) -> None:
    """The embedded cluster's owner is a superuser, whom a read-only transaction does not hold."""
    file = tmp_path / "written"
    tmp_path.chmod(0o777)
    with engine.connect() as connection:
        for statement in (
            f"COPY (SELECT 1) TO '{file}'",
            "SELECT pg_read_file('/etc/passwd')",
            f"COPY (SELECT 1) TO PROGRAM 'touch {file}'",
        ):
            with pytest.raises(Exception, match=r"permission denied|must be superuser"):
                run_sql(connection, statement, write=False)
            connection.rollback()
        assert run_sql(connection, "SELECT count(*) FROM face", write=False) == (["count"], [(0,)])
    assert not file.exists()


@pytest.mark.parametrize(
    ("statement", "word"),
    [
        ("select 1", "SELECT"),
        ("\n\t(( Values (1)))", "VALUES"),
        ("", ""),
        ("-- SELECT", ""),
        ("-- a\rDO 'x'", "DO"),
        ("/* */SET x = 1", "SET"),
        ("/* /* */ SELECT */ SET", "SET"),
        ("/* SELECT", ""),
        ("*/ SELECT", ""),
        ("1 SELECT", ""),
        ("'SELECT'", ""),
        ('"SELECT"', ""),
        ("SELECTED", "SELECTED"),
        ("ſelect", "SELECT"),
        (";;SHOW x", "SHOW"),
        ("- - SELECT", ""),
    ],
)
def test_kind(statement: str, word: str) -> None:
    assert kind(statement) == word


WORDS = {"SELECT": "SELECT 1", "DO": "DO 'BEGIN END'", "SET": "SET work_mem = 64"}


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.sampled_from(["--", "/*", "*/", "\n", "\r", " ", "SELECT 1", "(", ";", "x"])),
    st.sampled_from([*WORDS]),
)
def test_what_the_server_takes_begins_with_its_word(
    module_engine: Engine, before: list[str], word: str
) -> None:
    """Whatever stands before it: if the server reads it as that statement, so do we."""
    statement = "".join(before) + WORDS[word]
    with module_engine.connect() as connection:
        driver = connection.connection.driver_connection
        assert isinstance(driver, psycopg.Connection)
        taken = driver.pgconn.prepare(b"x", statement.encode()).status == ExecStatus.COMMAND_OK
        tag = ""
        if taken:
            done = driver.pgconn.exec_prepared(b"x", [])
            tag = (done.command_status or b"").decode().split(" ")[0]
        connection.invalidate()
    if tag:
        assert kind(statement) == tag
