"""Suggestions of similar names, the most similar first."""

from __future__ import annotations

import pytest

from semmap.suggestions import similar_names, suggestion

KNOWN = ["kitchen", "kitchen2", "bedroom", "bathroom"]


@pytest.mark.parametrize(
    ("name", "names"),
    [
        ("kichen", ["kitchen", "kitchen2"]),
        ("bedrom", ["bedroom", "bathroom"]),
        ("cellar", []),
        ("bath", ["bathroom"]),
    ],
)
def test_similar_names_come_in_order(name: str, names: list[str]) -> None:
    assert similar_names(name, KNOWN) == names
    assert similar_names(name, iter(KNOWN), count=1) == names[:1]


def test_a_suggestion_ends_an_error() -> None:
    assert suggestion("kichen", KNOWN) == "; did you mean kitchen or kitchen2?"
    assert suggestion("cellar", KNOWN) == ""
    assert suggestion("cellar", KNOWN, "semmap ls lists them") == "; semmap ls lists them"
    assert suggestion("cellar", []) == ""
