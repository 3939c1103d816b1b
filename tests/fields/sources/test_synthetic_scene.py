"""A staged scene: who stands where, what is seen of it, and the demo that is made of it."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from sqlalchemy import Engine

from semmap.fields.demo import field_demo
from semmap.fields.sources.synthetic_scene import Actor, Prop, Stage, standpoints
from semmap.geometry.mesh import box_mesh
from semmap.ingest.importer import import_file

NOW = datetime(2026, 11, 21, tzinfo=UTC)
OFFICE = Path(__file__).parents[3] / "examples" / "office"


def prop(name: str, type_: str, low: tuple[float, ...], high: tuple[float, ...]) -> Prop:
    return Prop(name, type_, box_mesh(low, high).triangles)  # type: ignore[arg-type]


TABLE = prop("table1", "table", (-0.4, -0.4, 0), (0.4, 0.4, 0.75))
MUG = prop("mug1", "mug", (-0.05, -0.05, 0.75), (0.05, 0.05, 0.85))
WALL = prop("wall1", "wall", (-3, -0.9, 0), (3, -0.8, 2.5))


def test_people_have_a_size() -> None:
    body = Actor("anna", 1, 2, 0.5, (3, 2, 1)).body.triangles.reshape(-1, 3)
    low, high = body.min(axis=0), body.max(axis=0)
    np.testing.assert_allclose(low, (1 - 0.19, 2 - 0.19, 0.5), atol=0.01)
    np.testing.assert_allclose(high, (1.19, 2.19, 0.5 + 1.75), atol=0.01)


def test_where_they_look() -> None:
    stage = Stage([TABLE], [Actor("anna", 2, 0, 0, (0, 0, 0.8))], NOW)
    pose = np.asarray(stage.gazes().poses["anna"])
    eye, axis = pose[:3, 3], pose[:3, 2]
    reached = eye + axis * np.linalg.norm(np.array((0, 0, 0.8)) - eye)
    np.testing.assert_allclose(reached, (0, 0, 0.8), atol=1e-9)
    assert stage.motions().people["anna"].yaw == pytest.approx(math.pi)


def test_masks_are_of_what_is_in_front() -> None:
    anna = Actor("anna", 1.0, 0.0, 0, (0, 0, 0.8))
    stage = Stage([TABLE, MUG, WALL], [anna], NOW)
    seen = stage.seen((2.5, 0.0, 1.5), (0, 0, 0.8))
    number = {name: i for i, name in seen.names.items()}
    labels, depth = np.asarray(seen.labels), np.asarray(seen.depth)
    assert set(number) == {"table", "mug", "wall", "person"}
    assert not (labels == number["mug"]).any(), "anna stands before it"
    assert depth[labels == number["person"]].mean() == pytest.approx(1.5, abs=0.3)
    people = stage.people(stage.seen((2.5, 0, 1.5), (0, 0, 0.8), of=lambda p: p.name))
    assert list(people.names.values()) == ["anna"]
    assert (np.asarray(people.labels) > 0).sum() == (labels == number["person"]).sum()
    other = stage.seen((0, 2.0, 1.5), (0, 0, 0.8))
    assert (np.asarray(other.labels) == number["mug"]).any()


def test_places_to_stand() -> None:
    places = standpoints(Stage([TABLE, MUG, WALL], [], NOW), "mug1", 0.0)
    assert len(places) >= 3
    for x, y in places:
        assert y > -0.8 + 0.3 or y < -0.9 - 0.3, "not in the wall"
        assert math.hypot(x, y) > 0.6
        seen = Stage([TABLE, MUG, WALL], [], NOW).seen((x, y, 1.6), (0, 0, 0.8))
        assert "mug" in {seen.names[i] for i in np.unique(seen.labels) if i}


def test_the_demo_in_the_office(engine: Engine, tmp_path: Path) -> None:
    for name in ("office_rooms.geojson", "office.sdf"):
        import_file(engine, OFFICE / name, map_name="office")
    said: list[str] = []
    with engine.connect() as connection:
        (picture,) = field_demo(connection, tmp_path, said.append, voxel_size=0.03)
    assert "   ?voxels :containsObject 'muffin'" in said
    count = int(next(line for line in said if "voxels of" in line).split()[0])
    assert 5 < count < 60
    pixels = np.asarray(Image.open(picture).convert("RGB")).reshape(-1, 3).astype(int)
    assert ((pixels[:, 0] > 130) & (pixels[:, 1] < 70) & (pixels[:, 2] < 110)).sum() > 30
