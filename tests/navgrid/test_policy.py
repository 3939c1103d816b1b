"""The layer of each entity, by the default policy and by files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from navgrid.policy import Policy, PolicyError
from semmap.query.storey_scene import SceneEntity


def layer(kind: Any, *types: str, **fields: Any) -> str:
    return Policy.default().layer_of(SceneEntity(1, "x", kind, (*types, kind), **fields))


@pytest.mark.parametrize(
    ("entity", "expected"),
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
def test_the_default_policy(entity: tuple[Any, ...], expected: str) -> None:
    assert layer(*entity) == expected


def test_doors_go_by_state_and_objects_by_properties() -> None:
    assert layer("connector", "door", state="open") == "none"
    assert layer("connector", "door", state="closed") == "room_geometry"
    assert layer("connector", "door", state="locked") == "room_geometry"
    assert layer("object", "desk", "table", properties={"workplace": "human"}) == "lethal_obstacles"
    assert layer("object", "desk", "table", properties={"workplace": "robot"}) == (
        "admissible_objects"
    )
    assert layer("region", "zone", properties={"blocked": True}) == "blocked_regions"
    assert layer("region", "zone", properties={"blocked": False}) == "none"


def test_the_first_rule_that_applies_decides(tmp_path: Path) -> None:
    file = tmp_path / "policy.yaml"
    file.write_text(
        "layers: {near: {padding: 0.1}, far: }\n"
        "rules:\n"
        "  - {type: cup, properties: {full: true}, layer: far}\n"
        "  - {type: [cup, plate], layer: near}\n"
    )
    policy = Policy.read(file)
    assert [(la.name, la.padding) for la in policy.layers] == [("near", 0.1), ("far", 0.0)]
    entities = [
        SceneEntity(1, "a", "object", ("cup",), properties={"full": True}),
        SceneEntity(2, "b", "object", ("cup",)),
        SceneEntity(3, "c", "object", ("chair",)),
    ]
    assert [policy.layer_of(t) for t in entities] == ["far", "near", "none"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("layers: [", "YAML"),
        ("- a", r"document: is \['a'\]; give key: value"),
        ("layers: {a: }\nrules: {}", "rules: is {}; give a list"),
        ("layers: {}\nrules: []", "layers: is empty; give one or more"),
        (
            "layers: {a: }\nrules: []\nrule: 1",
            "unknown key rule; give some of fields, layers, rules",
        ),
        ("layers: {a: {padding: -1}}\nrules: []", "give 0 or more metres"),
        ("layers: {a: {padding: .nan}}\nrules: []", "give 0 or more metres"),
        ("layers: {a: {padding: wide}}\nrules: []", "padding is 'wide'"),
        ("layers: {floor: }\nrules: []", "layer floor: this name is reserved"),
        ("layers: {a: }\nrules: [{layer: b}]", "rule 1: layer is 'b'; give one of a, floor, none"),
        ("layers: {a: }\nrules: [{layer: [a]}]", r"layer is \['a'\]; give one of a, floor, none"),
        ("layers: {a: }\nrules: [{layer: {a: b}}]", "give one of a, floor, none"),
        ("layers: {a: }\nrules: [{layer: a, kind: [room]}]", "give one of room"),
        ("layers: {a: }\nrules: [{layer: a, state: [open]}]", "give one of open, closed, locked"),
        ("layers: {a: }\nrules: [{layer: a, kind: thing}]", "kind is 'thing'; give one of room"),
        (
            "layers: {a: }\nrules: [{layer: a, state: ajar}]",
            "state is 'ajar'; give one of open, closed, locked",
        ),
        (
            "layers: {a: }\nrules: [{layer: a, type: 3}]",
            "type is 3; give a name or a list of names",
        ),
        ("layers: {a: }\nrules: [{layer: a, typ: x}]", "rule 1: unknown key typ; give some of"),
        ("layers: {a: }\nrules: [{layer: a, properties: x}]", "rule 1, properties"),
    ],
)
def test_invalid_policies_are_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(PolicyError, match=message) as caught:
        Policy.read(file)
    assert "mine.yaml" in str(caught.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="cannot be read"):
        Policy.read(tmp_path / "none.yaml")
