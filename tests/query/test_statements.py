"""The first word of a statement, as the server finds it."""

from __future__ import annotations

import psycopg
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from psycopg.pq import ExecStatus
from sqlalchemy import Engine

from semmap.query.statements import kind


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
