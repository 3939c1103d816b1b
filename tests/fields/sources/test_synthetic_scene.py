"""A synthetic scene: its people, its images, and the demo that uses it."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from sqlalchemy import Engine

from semmap.cli.demo.fields import field_demo
from semmap.fields.sources.synthetic_scene import (
    ScenePerson,
    SyntheticScene,
    VisibleObject,
    standpoints,
)
from semmap.geometry.mesh import box_mesh
from tests.seen import seen_by

NOW = datetime(2026, 11, 21, tzinfo=UTC)


def visible(
    name: str, type_: str, low: tuple[float, ...], high: tuple[float, ...]
) -> VisibleObject:
    return VisibleObject(name, type_, box_mesh(low, high).triangles)  # type: ignore[arg-type]


TABLE = visible("table1", "table", (-0.4, -0.4, 0), (0.4, 0.4, 0.75))
MUG = visible("mug1", "mug", (-0.05, -0.05, 0.75), (0.05, 0.05, 0.85))
WALL = visible("wall1", "wall", (-3, -0.9, 0), (3, -0.8, 2.5))


def test_the_size_of_a_person() -> None:
    body = ScenePerson("anna", 1, 2, 0.5, (3, 2, 1)).body.triangles.reshape(-1, 3)
    low, high = body.min(axis=0), body.max(axis=0)
    np.testing.assert_allclose(low, (1 - 0.19, 2 - 0.19, 0.5), atol=0.01)
    np.testing.assert_allclose(high, (1.19, 2.19, 0.5 + 1.75), atol=0.01)


def test_where_people_look() -> None:
    scene = SyntheticScene([TABLE], [ScenePerson("anna", 2, 0, 0, (0, 0, 0.8))], NOW)
    pose = np.asarray(scene.gazes().poses["anna"])
    eye, axis = pose[:3, 3], pose[:3, 2]
    reached = eye + axis * np.linalg.norm(np.array((0, 0, 0.8)) - eye)
    np.testing.assert_allclose(reached, (0, 0, 0.8), atol=1e-9)
    assert scene.motions().people["anna"].yaw == pytest.approx(math.pi)


def test_labels_are_those_of_the_nearest_objects() -> None:
    anna = ScenePerson("anna", 1.0, 0.0, 0, (0, 0, 0.8))
    scene = SyntheticScene([TABLE, MUG, WALL], [anna], NOW)
    image = scene.image((2.5, 0.0, 1.5), (0, 0, 0.8))
    number = {name: i for i, name in image.names.items()}
    labels, depth = np.asarray(image.labels), np.asarray(image.depth)
    assert set(number) == {"table", "mug", "wall", "person"}
    assert not (labels == number["mug"]).any(), "anna is in front of it"
    assert depth[labels == number["person"]].mean() == pytest.approx(1.5, abs=0.3)
    people = scene.image_of_people(
        scene.image((2.5, 0, 1.5), (0, 0, 0.8), label=lambda each: each.name)
    )
    assert list(people.names.values()) == ["anna"]
    assert (np.asarray(people.labels) > 0).sum() == (labels == number["person"]).sum()
    other = scene.image((0, 2.0, 1.5), (0, 0, 0.8))
    assert (np.asarray(other.labels) == number["mug"]).any()


def test_places_from_which_an_object_is_visible() -> None:
    places = standpoints(SyntheticScene([TABLE, MUG, WALL], [], NOW), "mug1", 0.0)
    assert len(places) >= 3
    for x, y in places:
        assert y > -0.8 + 0.3 or y < -0.9 - 0.3, "outside of the wall"
        assert math.hypot(x, y) > 0.6
        image = SyntheticScene([TABLE, MUG, WALL], [], NOW).image((x, y, 1.6), (0, 0, 0.8))
        assert "mug" in {image.names[i] for i in np.unique(image.labels) if i}


def test_the_demo_in_the_office(office_world: Engine, tmp_path: Path) -> None:
    said: list[str] = []
    with office_world.connect() as connection:
        (picture,) = field_demo(seen_by(connection), tmp_path, said.append, voxel_size=0.03)
    assert "   ?voxels :containsObject 'muffin'" in said
    count = int(next(line for line in said if "voxels of" in line).split()[0])
    assert 5 < count < 60
    pixels = np.asarray(Image.open(picture).convert("RGB")).reshape(-1, 3).astype(int)
    assert ((pixels[:, 0] > 130) & (pixels[:, 1] < 70) & (pixels[:, 2] < 110)).sum() > 30
