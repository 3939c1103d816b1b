"""Which entity goes where, as the default says it and as files may."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from navgrid.policy import Policy, PolicyError
from navgrid.scene import Thing


def layer(kind: Any, *types: str, **said: Any) -> str:
    return Policy.default().layer_of(Thing(1, "x", kind, (*types, kind), **said))


@pytest.mark.parametrize(
    ("said", "wanted"),
    [
        (("object", "mug"), "admissible_objects"),
        (("object", "wall", "building_element"), "room_geometry"),
        (("object", "floor", "building_element"), "floor"),
        (("room", "kitchen"), "floor"),
        (("region", "staircase"), "blocked_regions"),
        (("region", "keepout_zone", "blocked_region"), "blocked_regions"),
        (("region", "home_region"), "none"),
        (("agent", "person"), "none"),
        (("object",), "admissible_objects"),
    ],
)
def test_the_default(said: tuple[Any, ...], wanted: str) -> None:
    assert layer(*said) == wanted


def test_doors_by_state_and_what_people_said() -> None:
    assert layer("connector", "door", state="open") == "none"
    assert layer("connector", "door", state="closed") == "room_geometry"
    assert layer("connector", "door", state="locked") == "room_geometry"
    assert layer("object", "desk", "table", properties={"workplace": "human"}) == "lethal_obstacles"
    assert layer("object", "desk", "table", properties={"workplace": "robot"}) == (
        "admissible_objects"
    )
    assert layer("region", "zone", properties={"blocked": True}) == "blocked_regions"
    assert layer("region", "zone", properties={"blocked": False}) == "none"


def test_the_first_rule_that_fits_decides(tmp_path: Path) -> None:
    file = tmp_path / "policy.yaml"
    file.write_text(
        "layers: {near: {padding: 0.1}, far: }\n"
        "rules:\n"
        "  - {type: cup, properties: {full: true}, layer: far}\n"
        "  - {type: [cup, plate], layer: near}\n"
    )
    policy = Policy.read(file)
    assert [(la.name, la.padding) for la in policy.layers] == [("near", 0.1), ("far", 0.0)]
    asked = [
        Thing(1, "a", "object", ("cup",), properties={"full": True}),
        Thing(2, "b", "object", ("cup",)),
        Thing(3, "c", "object", ("chair",)),
    ]
    assert [policy.layer_of(t) for t in asked] == ["far", "near", "none"]


@pytest.mark.parametrize(
    ("said", "says"),
    [
        ("layers: [", "is no YAML"),
        ("- a", "the file: give key: value"),
        ("layers: {a: }\nrules: {}", "rules as a list"),
        ("layers: {}\nrules: []", "needs layers"),
        ("layers: {a: }\nrules: []\nrule: 1", "knows no rule"),
        ("layers: {a: {padding: -1}}\nrules: []", "0 or more metres"),
        ("layers: {a: {padding: .nan}}\nrules: []", "0 or more metres"),
        ("layers: {a: {padding: wide}}\nrules: []", "padding is metres"),
        ("layers: {floor: }\nrules: []", "a name but none and floor"),
        ("layers: {a: }\nrules: [{layer: b}]", "rule 1: its layer is one of a, floor, none"),
        ("layers: {a: }\nrules: [{layer: [a]}]", "rule 1: its layer is one of a, floor, none"),
        ("layers: {a: }\nrules: [{layer: {a: b}}]", "rule 1: its layer is one of a, floor, none"),
        ("layers: {a: }\nrules: [{layer: a, kind: [room]}]", "its kind is one of room"),
        ("layers: {a: }\nrules: [{layer: a, state: [open]}]", "open, closed or locked"),
        ("layers: {a: }\nrules: [{layer: a, kind: thing}]", "its kind is one of room"),
        ("layers: {a: }\nrules: [{layer: a, state: ajar}]", "open, closed or locked"),
        ("layers: {a: }\nrules: [{layer: a, type: 3}]", "a name or a list of names"),
        ("layers: {a: }\nrules: [{layer: a, typ: x}]", "rule 1: knows no typ"),
        ("layers: {a: }\nrules: [{layer: a, properties: x}]", "rule 1, properties"),
    ],
)
def test_files_that_are_no_policy(tmp_path: Path, said: str, says: str) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(said)
    with pytest.raises(PolicyError, match=says) as caught:
        Policy.read(file)
    assert "mine.yaml" in str(caught.value)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="cannot be read"):
        Policy.read(tmp_path / "none.yaml")
