"""Queries that would take minutes or gigabytes are refused, and say which limit they exceed."""

from __future__ import annotations

import time

import pytest

from semmap.fields.language import QueryError, Rows, query
from tests.fields.language.catalogue import PREFIX, kitchen


def matching(pattern: str, flags: str = "") -> list[str]:
    """The things whose names a regular expression is found in."""
    condition = f"REGEX(STR(?o), '{pattern}', '{flags}')"
    text = f"SELECT DISTINCT ?o {{ ?v :occupiedBy ?o FILTER({condition}) }} ORDER BY ?o"
    answer = query(kitchen(), PREFIX + text)
    assert isinstance(answer, Rows)
    return [row[0] for row in answer]


@pytest.mark.parametrize(
    ("pattern", "flags", "names"),
    [
        ("^c", "", ["cup1"]),
        ("^C", "", []),
        ("^C", "i", ["cup1"]),
        ("^ c u p 1 $", "", []),
        ("^ c u p 1 $ # a comment", "x", ["cup1"]),
        (r"(u).*\\1|(.)u\\2", "", []),
        ("^.+$", "ms", ["cup1", "mug1", "table1"]),
        ("^(?=.u).{4}$", "", ["cup1", "mug1"]),
        (r"^\\w+\\d$", "", ["cup1", "mug1", "table1"]),
    ],
)
def test_flags_and_patterns(pattern: str, flags: str, names: list[str]) -> None:
    assert matching(pattern, flags) == names


ATTACKS = ["^(a|aa)+$", "^((a{1,99}){1,99}){1,99}$", "^(a|a)*$"]
QUICK = ["^(a+)+$", "(?:a?){60}a{60}c", "^(.*a){60}x"]


@pytest.mark.parametrize("pattern", ATTACKS)
def test_a_pattern_that_backtracks_without_end_is_stopped(pattern: str) -> None:
    text = f"SELECT ?x {{ ?x :on ?y FILTER(REGEX('{'a' * 60}b', '{pattern}')) }}"
    start = time.perf_counter()
    with pytest.raises(QueryError, match=r"longer than 1 s for one name.*SEMMAP_MAX_REGEX_SECONDS"):
        query(kitchen(), PREFIX + text)
    assert time.perf_counter() - start < 5


@pytest.mark.parametrize("pattern", QUICK)
def test_a_pattern_with_nested_repetitions_may_be_quick(pattern: str) -> None:
    text = f"SELECT ?x {{ ?x :on ?y FILTER(REGEX('{'a' * 60}b', '{pattern}')) }}"
    answer = query(kitchen(), PREFIX + text)
    assert isinstance(answer, Rows)
    assert len(answer) == 0


@pytest.mark.parametrize("pattern", ["(" * 5000 + "a" + ")" * 5000, "(?V1)a", "a{3,2}", "["])
def test_a_pattern_that_is_none(pattern: str) -> None:
    with pytest.raises(QueryError, match="no regular expression"):
        matching(pattern)


def test_time_and_rows_of_a_query(monkeypatch: pytest.MonkeyPatch) -> None:
    text = PREFIX + "SELECT ?v ?w { ?v :occupiedBy ?a . ?w :occupiedBy ?b }"
    answer = query(kitchen(), text)
    assert isinstance(answer, Rows)
    monkeypatch.setenv("SEMMAP_MAX_QUERY_ROWS", str(len(answer) - 1))
    with pytest.raises(QueryError, match="SEMMAP_MAX_QUERY_ROWS raises the limit"):
        query(kitchen(), text)
    monkeypatch.setenv("SEMMAP_MAX_QUERY_ROWS", str(len(answer)))
    assert len(query(kitchen(), text)) == len(answer)  # type: ignore[arg-type]
    monkeypatch.setenv("SEMMAP_MAX_QUERY_SECONDS", "1e-9")
    with pytest.raises(QueryError, match=r"takes longer than 1e-09 s.*SEMMAP_MAX_QUERY_SECONDS"):
        query(kitchen(), text)
