"""What a model's name suggests."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.ingest.naming import TYPE_WORDS, guess_type, unique_name
from semmap.ingest.ontology.tbox import read_tbox

ONTOLOGY = sorted(Path(__file__).parents[2].joinpath("schema", "ontology").glob("*.ttl"))
OBJECTS = {r.name: r.label for r in read_tbox(ONTOLOGY) if r.kind == "object" != r.name}


@pytest.mark.parametrize(
    ("name", "type_"),
    [
        ("aws_robomaker_residential_DeskChair_01", "chair"),
        ("Stool_3", "stool"),
        ("ChairA_01_001", "chair"),
        ("TVCabinet_01", "tv_cabinet"),
        ("TV_02", "tv"),
        ("kitchen_table", "kitchen_table"),
        ("KitchenCabinet", "kitchen_cabinet"),
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


def test_every_label_of_an_object_suggests_it() -> None:
    assert len(OBJECTS) > 100
    for name, label in OBJECTS.items():
        assert guess_type(label) == name
        assert guess_type(f"Acme{label.title().replace(' ', '')}B_01") == name


@pytest.mark.parametrize("type_", TYPE_WORDS)
def test_words_of_model_makers(type_: str) -> None:
    assert type_ in OBJECTS
    for phrase in TYPE_WORDS[type_].split(", "):
        assert guess_type(phrase) == type_


@given(st.lists(st.sampled_from(["a", "a_2", "b"]), max_size=8))
def test_unique_names_are_unique_and_keep_the_first(names: list[str]) -> None:
    taken: list[str] = []
    for name in names:
        taken.append(unique_name(name, taken))
        assert taken[-1] == name or name in taken[:-1]
    assert len(set(taken)) == len(taken)
