"""Searches for things: what they believe."""

from __future__ import annotations

from pathlib import Path

import pytest

import semmap
from tests.planner.search.pomdp_reader import read_pomdp


def test_a_search_and_where_believe_the_same(flat: semmap.Map) -> None:
    """Of a thing and of its type, before and after it was missed; the looks have other chances."""
    for observed in (None, False, True):
        if observed is not None:
            flat.observe("mug7", "desk4", seen=observed)
        for word in ("mug7", "mug"):
            search = flat.search(word, start="hall")
            assert search.belief == pytest.approx(dict(flat.where(word)), abs=1e-6)
            assert search.as_json()["belief"] == search.belief
            assert search.reason.endswith("50% of each chance is the prior, the rest the belief")


def test_a_search_of_a_building_is_written_for_other_solvers(
    flat: semmap.Map, tmp_path: Path
) -> None:
    search = flat.search("mug7", start="hall")
    whole = read_pomdp(search.write_pomdp(tmp_path / "whole.pomdp", most_states=10**6))
    most = len(whole.states) // 2
    file = search.write_pomdp(tmp_path / "joined.pomdp", most_states=most)
    joined = read_pomdp(file)
    assert len(joined.states) <= most
    first = file.read_text().partition("\n")[0]
    assert first.startswith(f"# {len(whole.states)} states joined to {len(joined.states)}: ")
    places = search.problem.problem.places
    assert sum(action.startswith("declare") for action in joined.actions) == len(places)
