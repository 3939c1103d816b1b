"""What a model's name suggests."""

from __future__ import annotations

import doctest

import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.ingest import naming
from semmap.ingest.naming import TYPE_WORDS, guess_type, unique_name


def test_examples_in_the_docstrings() -> None:
    assert doctest.testmod(naming).attempted > 0
    assert doctest.testmod(naming).failed == 0


@pytest.mark.parametrize(
    ("name", "type_"),
    [
        ("aws_robomaker_residential_DeskChair_01", "chair"),
        ("ChairA_01_001", "chair"),
        ("TVCabinet_01", "cabinet"),
        ("TV_02", "tv"),
        ("kitchen_table", "kitchen_table"),
        ("KitchenCabinet", "cabinet"),
        ("AirConditionerC_01", "air_conditioner"),
        ("006_mustard_bottle", "bottle"),
        ("trash-can 3", "trash_can"),
        ("RoomWindow_01_009", "window"),
        ("unit_7", None),
        ("", None),
        ("Bedrock", None),
    ],
)
def test_guess(name: str, type_: str | None) -> None:
    assert guess_type(name) == type_


@pytest.mark.parametrize("type_", TYPE_WORDS)
def test_every_type_is_guessed_from_its_own_name(type_: str) -> None:
    assert guess_type(type_) == type_
    assert guess_type("Acme" + type_.title().replace("_", "") + "B_01") == type_


def test_no_phrase_suggests_two_types() -> None:
    phrases = [p for line in TYPE_WORDS.values() for p in line.split(", ")]
    assert len(phrases) == len(set(phrases))


@given(st.lists(st.sampled_from(["a", "a_2", "b"]), max_size=8))
def test_unique_names_are_unique_and_keep_the_first(names: list[str]) -> None:
    taken: list[str] = []
    for name in names:
        taken.append(unique_name(name, taken))
        assert taken[-1] == name or name in taken[:-1]
    assert len(set(taken)) == len(taken)
