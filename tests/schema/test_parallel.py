"""Functions that parallel workers call can be called by them."""

from __future__ import annotations

import re

import pytest

import semmap

CALLED = re.compile(r"\b([a-z_0-9]+)\s*\(")


def test_what_begins_a_subtransaction_is_not_parallel_safe(room: semmap.Map) -> None:
    """A block with EXCEPTION does; it, and who calls it, ends a parallel query with an error."""
    functions = room.connection.execute(
        "SELECT proname, pg_get_functiondef(oid), proparallel::text FROM pg_proc "
        "WHERE pronamespace = 'semmap'::regnamespace AND prokind = 'f'"
    ).fetchall()
    unsafe = {name for name, body, _ in functions if re.search(r"\bEXCEPTION\s+WHEN\b", body)}
    assert {"rdf_regex", "text_geometry"} <= unsafe
    while True:
        callers = {name for name, body, _ in functions if unsafe & {*CALLED.findall(body)}}
        if callers <= unsafe:
            break
        unsafe |= callers
    assert not [name for name, _, parallel in functions if name in unsafe and parallel == "s"]


@pytest.mark.parametrize(
    "value",
    [
        "text_number(n || '5e3')",
        "text_time('2026-01-0' || n)",
        "rdf_order(n || '', 'http://www.w3.org/2001/XMLSchema#integer', '5', "
        "'http://www.w3.org/2001/XMLSchema#integer')",
        "rdf_calculate('-', '2026-01-0' || n, 'http://www.w3.org/2001/XMLSchema#date', 'P1D', "
        "'http://www.w3.org/2001/XMLSchema#dayTimeDuration')",
        "rdf_calculate_double('*', 1e200, n * 1e200)",
    ],
)
def test_values_are_compared_by_parallel_workers(room: semmap.Map, value: str) -> None:
    session = room.connection
    with session.transaction(force_rollback=True):
        session.execute("CREATE TABLE shared AS SELECT n FROM generate_series(1, 9) n")
        session.execute(
            "SELECT set_config(name, 'on', true) FROM pg_settings "
            "WHERE name IN ('force_parallel_mode', 'debug_parallel_query')"
        )
        plan = session.execute(f"EXPLAIN SELECT count({value}) FROM shared").fetchall()
        assert any("Gather" in line for (line,) in plan)
        assert session.execute(f"SELECT count({value}) FROM shared").fetchone() == (9,)
