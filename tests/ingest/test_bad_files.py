"""Any damage to a world file either refuses the file, or leaves something out and says so."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from semmap.ingest.sdf.world_file import read_sdf
from semmap.ingest.world import World, WorldError

OBJ = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 4 3\nf 1 2 4\nf 2 3 4\n"

MODEL = """<?xml version="1.0"?>
<sdf version="1.9"><model name="Desk_01"><static>true</static>
  <link name="top"><pose>0 0 0.7 0 0 0</pose>
    <visual name="v"><geometry><mesh><uri>model://Desk_01/solid.obj</uri><scale>1 1 0.5</scale>
      </mesh></geometry></visual>
    <collision name="c"><geometry><box><size>1 2 0.1</size></box></geometry></collision></link>
  <link name="leg"><pose relative_to="top">0 0 -0.7 0 0 0</pose>
    <visual name="v"><geometry><cylinder><radius>0.1</radius><length>0.7</length></cylinder>
      </geometry></visual></link>
  <joint name="j" type="fixed"><parent>top</parent><child>leg</child></joint>
</model></sdf>"""

WORLD = """<?xml version="1.0" encoding="utf-8"?>
<sdf version="1.9"><world name="office">
  <light name="sun" type="point"/>
  <frame name="corner"><pose>5 5 0 0 0 1.57</pose></frame>
  <include><uri>model://Desk_01</uri><name>desk1</name>
    <pose relative_to="corner">1 0 0 0 0 0</pose></include>
  <include><uri>file://models/Desk_01</uri><pose degrees="true">3 0 0 0 0 90</pose></include>
  <model name="Chair_01"><include><uri>model://Desk_01/model.sdf</uri></include>
    <pose rotation_format="quat_xyzw">1 2 0 0 0 0.6 0.8</pose></model>
  <model name="Shelf_01"><pose relative_to="desk1::top">2 0 0 0 0 0</pose><static>1</static>
    <model name="board"><pose>0 0 1 0 0 0</pose><link name="l"><visual name="v"><geometry>
      <sphere><radius>0.2</radius></sphere></geometry></visual></link></model>
    <link name="l"><visual name="v"><geometry><polyline><point>0 0</point><point>1 0</point>
      <point>0 1</point><height>2</height></polyline></geometry></visual></link></model>
  <actor name="walker"><pose>0 0 0 0 0 0</pose></actor>
</world></sdf>"""

FILES = {
    "office.world": WORLD,
    "models/Desk_01/model.sdf": MODEL,
    "models/Desk_01/solid.obj": OBJ,
    "models/Desk_01/model.config": '<model><sdf version="1.9">model.sdf</sdf></model>',
}
WHOLE = 5
"""Entries of the undamaged world."""

ODD = ["", "nan", "-inf", "1e400", "1e300", "0", "-1", "x", "343582.9", "desk1", "Shelf_01::board"]
ODD += [
    "__model__",
    "world",
    "top",
    "leg",
    "corner",
    "model://Desk_01",
    "../..",
    "&#233;",
    "9" * 400,
]
ODD += ["file:///", "model://", "http://a/b", "a" * 300, "true", "1 2 3", "0 0 0 0 0 0"]

numbering = itertools.count()


def build(folder: Path, changed: dict[str, bytes]) -> Path:
    """The files of the office, some of them changed, in a folder of their own."""
    root = folder / str(next(numbering))
    for name, text in FILES.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(changed.get(name, text.encode()))
    return root / "office.world"


def attempt(path: Path, geometry: str = "visual") -> World | None:
    """The world, which must be sound, or None where it is refused with a reason and a fix."""
    try:
        world = read_sdf(path, geometry=geometry)  # type: ignore[arg-type]
    except WorldError as error:
        said = [error.path, error.element, error.problem, error.fix]
        if not all(said):
            raise AssertionError(f"an error that does not say all: {said}") from error
        return None
    names = [e.name for e in world.entries]
    assert len(set(names)) == len(names)
    for entry in world.entries:
        assert entry.name
        assert entry.pose is not None
        assert np.isfinite(entry.pose).all()
        assert np.abs(entry.pose.translation).max() <= 10_000
        turn = entry.pose.rotation_matrix
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        for shape in entry.shapes:
            assert shape.mesh is not None
            assert np.isfinite(shape.mesh.vertices).all()
            assert np.abs(shape.mesh.vertices).max() <= 10_000
            assert 0 <= shape.mesh.faces.min() <= shape.mesh.faces.max() < len(shape.mesh.vertices)
    for skipped in world.skipped:
        assert skipped.element
        assert skipped.problem
        assert skipped.fix
    return world


quick = settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
texts = st.sampled_from([n for n in FILES if n.endswith(("world", "sdf"))])


def test_the_undamaged_world_is_whole(tmp_path: Path) -> None:
    world = attempt(build(tmp_path, {}))
    assert world is not None
    assert len(world.entries) == WHOLE
    assert world.skipped == []
    assert all(e.shapes for e in world.entries if e.kind == "object")


@quick
@given(name=texts, cut=st.floats(0, 1))
def test_a_truncated_world_is_refused_and_a_model_left_out(
    tmp_path: Path, name: str, cut: float
) -> None:
    data = FILES[name].encode()
    end = min(round(cut * len(data)), len(data) - 1)
    world = attempt(build(tmp_path, {name: data[:end]}))
    if name.endswith(".world"):
        assert world is None
    else:
        assert world is not None
        assert any("cannot be used" in skipped.problem for skipped in world.skipped)


VALUE = re.compile(r'(?<==")[^"]*(?=")|(?<=>)[^<>]+(?=</)|(?<=[ >])-?[\d.]+(?=[ <])')
"""An attribute's value, an element's text, or one number in it."""


@quick
@given(name=texts, which=st.floats(0, 1, exclude_max=True), value=st.sampled_from(ODD))
@example(name="office.world", which=0.0, value="&#233;")
def test_a_changed_value_is_refused_left_out_or_harmless(
    tmp_path: Path, name: str, which: float, value: str
) -> None:
    text = FILES[name]
    spans = [m.span() for m in VALUE.finditer(text) if m.start() > text.index("<sdf")]
    start, end = spans[int(which * len(spans))]
    for geometry in ("visual", "collision"):
        path = build(tmp_path, {name: (text[:start] + value + text[end:]).encode()})
        world = attempt(path, geometry)
        if world is not None and len(world.entries) < WHOLE:
            assert world.skipped, "what is missing is named"


ELEMENT = re.compile(r"<(\w+)[^<>]*?(?:/>|>(?:[^<]*)</\1>)")
"""An element without children."""


@quick
@given(
    name=texts,
    which=st.floats(0, 1, exclude_max=True),
    times=st.sampled_from([0, 2, 3]),
)
def test_a_removed_or_repeated_element(tmp_path: Path, name: str, which: float, times: int) -> None:
    text = FILES[name]
    spans = [m.span() for m in ELEMENT.finditer(text)]
    start, end = spans[int(which * len(spans))]
    changed = text[:start] + text[start:end] * times + text[end:]
    attempt(build(tmp_path, {name: changed.encode()}))


@quick
@given(
    name=st.sampled_from(list(FILES)),
    noise=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1),
)
def test_random_bytes(tmp_path: Path, name: str, noise: list[tuple[float, int]]) -> None:
    data = bytearray(FILES[name].encode())
    for place, byte in noise:
        data[int(place * len(data))] = byte
    attempt(build(tmp_path, {name: bytes(data)}))


@pytest.mark.parametrize("name", [n for n in FILES if n != "office.world"])
def test_a_file_of_a_model_that_is_missing_leaves_its_instances_where_they_are(
    tmp_path: Path, name: str
) -> None:
    path = build(tmp_path, {})
    (path.parent / name).unlink()
    world = attempt(path)
    assert world is not None
    if name.endswith("config"):  # the folder's model.sdf is read without it
        assert len(world.entries) == WHOLE
    elif name.endswith("obj"):
        assert len(world.entries) == WHOLE
        assert [s.problem for s in world.skipped] == ["model://Desk_01/solid.obj is not found"]
    else:  # the shelf stands relative to the desk's top, which is unknown now
        assert len(world.entries) == WHOLE - 1
        assert any("'top', which model Desk_01" in s.problem for s in world.skipped)
