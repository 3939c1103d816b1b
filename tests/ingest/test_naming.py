"""What a model's name suggests."""

from __future__ import annotations

import math
import re
from itertools import count
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.naming import SIZES, TYPE_WORDS, give_type, guess_type
from semmap.ingest.ontology.tbox import read_tbox
from semmap.ingest.world import Entry, Shape, unique_name

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
        ("floor-3rd", "floor"),
        ("floor_2_pump", None),
        ("floor_1_nursesstation", None),
        ("elevator_01_car", None),
        ("FoodCourtBenchShort", "bench"),
        ("OfficeChairGrey", "office_chair"),
        ("", None),
        ("Bedrock", None),
        ("chair_kitchen_2", "chair"),
        ("sofa left living-room", "sofa"),
        ("kitchen", None),
        ("pump_kitchen", None),
        ("bed_room", None),
        ("KUECHE", None),
        ("Küchentisch_02", "kitchen_table"),
        ("großer Kühlschrank", "refrigerator"),
        ("mesa de comedor.001", "dining_table"),
        ("Étagère_Sud", None),
        ("chair_four", None),
        ("main_stairway", "stair_flight"),
        ("Rampe_2", "ramp_flight"),
        ("wheelchair ramp", "ramp_flight"),
    ],
)
def test_guess(name: str, type_: str | None) -> None:
    assert guessed(name) == type_


def guessed(name: str) -> str | None:
    guess = guess_type(name)
    return None if guess is None else guess.type


@pytest.mark.parametrize(
    ("name", "confidence"),
    [("Chair_3", 0.9), ("aws_KitchenTable_01", 0.8), ("DeskChair", 0.6), ("chair_red", 0.6)],
)
def test_how_sure_a_guess_is(name: str, confidence: float) -> None:
    guess = guess_type(name)
    assert guess is not None
    assert guess.confidence == confidence


def box(*size: float, pose: Pose = IDENTITY) -> Entry:
    mesh = box_mesh((0, 0, 0), size)  # type: ignore[arg-type]
    return Entry("e", "object", pose=pose, shapes=[Shape("mesh", mesh)])


@pytest.mark.parametrize(
    ("name", "entry", "type_"),
    [
        ("floor_2", box(6, 8, 0.2), "floor"),
        ("floor_2", box(6, 8, 3), None),  # a whole storey is not flat
        ("floor_1", box(0.4, 0.4, 0.3), None),  # a pump is not wide
        ("floor_1", box(6, 0.2, 8, pose=Pose.from_rpy(0, 0, 0, math.pi / 2, 0, 0)), "floor"),
        ("car", box(4.5, 1.8, 1.5), "car"),
        ("car", box(1.5, 1.5, 0.1), None),
        ("chair", box(9, 9, 9), "chair"),  # only what is driven on, and vehicles, are measured
        ("floor_2", Entry("e", "object"), "floor"),
    ],
)
def test_a_guess_contradicts_no_geometry(name: str, entry: Entry, type_: str | None) -> None:
    give_type(entry, (name,))
    assert entry.type == type_
    assert entry.properties.get("type_guess", {}).get("type") == type_


def test_types_with_sizes_are_known() -> None:
    assert SIZES.keys() <= OBJECTS.keys()


def test_every_label_of_an_object_suggests_it() -> None:
    assert len(OBJECTS) > 100
    for name, label in OBJECTS.items():
        assert guessed(label) == name
        assert guessed(f"Acme{label.title().replace(' ', '')}B_01") == name


@pytest.mark.parametrize("type_", TYPE_WORDS)
def test_words_of_model_makers(type_: str) -> None:
    assert type_ in OBJECTS
    for phrase in TYPE_WORDS[type_].split(", "):
        assert guessed(phrase) == type_


@given(st.lists(st.sampled_from(["a", "a_2", "b"]), max_size=8))
def test_unique_names_are_unique_and_keep_the_first(names: list[str]) -> None:
    taken: list[str] = []
    for name in names:
        taken.append(unique_name(name, taken))
        assert taken[-1] == name or name in taken[:-1]
    assert len(set(taken)) == len(taken)


@given(st.integers(0, 40), st.sets(st.integers(2, 60)))
def test_a_free_suffix_is_the_first_where_there_is_no_gap(dense: int, others: set[int]) -> None:
    """Oracle: each number is tried."""
    taken = {"a", *(f"a_{number}" for number in range(2, dense + 2))}
    assert unique_name("a", taken) == next(f"a_{n}" for n in count(2) if f"a_{n}" not in taken)
    taken |= {f"a_{number}" for number in others}
    found = unique_name("a", taken)
    assert found not in taken
    assert re.fullmatch("a_[1-9][0-9]*", found)
