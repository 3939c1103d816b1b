"""Searches for things: what they believe."""

from __future__ import annotations

import pytest

import semmap


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
