"""Suggestions of similar names, the most similar first."""

from __future__ import annotations

import pytest

from semmap.suggestions import similar_names, suggestion

KNOWN = ["kitchen", "kitchen2", "bedroom", "bathroom"]


@pytest.mark.parametrize(
    ("name", "names"),
    [
        ("kichen", ["kitchen", "kitchen2"]),
        ("bedrom", ["bedroom"]),
        ("garage", []),
    ],
)
def test_similar_names_come_in_order(name: str, names: list[str]) -> None:
    assert similar_names(name, KNOWN) == names
    assert similar_names(name, iter(KNOWN), count=1) == names[:1]


def test_a_suggestion_ends_an_error() -> None:
    assert suggestion("kichen", KNOWN) == "; similar names: kitchen, kitchen2"
    assert suggestion("kichen", KNOWN, 1) == "; similar names: kitchen"
    assert suggestion("garage", KNOWN) == ""
    assert suggestion("garage", []) == ""
