"""The models of an Open-RMF building, where their SDF files are on this machine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semmap.ingest.importer import read_world
from semmap.ingest.rmf import read_rmf
from tests.ingest.rmf.test_building import building, dump, entry, pose
from tests.ingest.sdf.worlds_by_hand import LINK, model_file, world_file


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """A building with two models Shop/OfficeChair on each storey."""
    path = tmp_path / "site" / "house.building.yaml"
    path.parent.mkdir()
    path.write_text(dump(building()))
    return path


def test_a_folder_gives_models_their_shapes(house: Path, tmp_path: Path) -> None:
    bare = read_rmf(house)
    chairs = [e for e in bare.entries if e.type == "office_chair"]
    assert len(chairs) == 4
    assert not any(e.shapes for e in chairs)
    moved = '<pose>0.5 0 0 0 0 0</pose><link name="base"><pose>0 0 1 0 0 0</pose>'
    model_file(tmp_path / "library", "OfficeChair", LINK.replace('<link name="base">', moved))
    world = read_world(house, model_path=[tmp_path / "library"])
    assert world.skipped == []
    found = [entry(world, e.name) for e in chairs]
    assert len({id(e.shapes[0].mesh) for e in found}) == 1, "read once"
    for chair in found:
        (shape,) = chair.shapes
        np.testing.assert_allclose(shape.mesh.bounds, [(-0.5, -1, -0.5), (0.5, 1, 2.5)])
        assert pose(world, chair.name) == pose(bare, chair.name), "an include's pose replaces"


@pytest.mark.parametrize("form", ["named in a building", "a URL of a world"])
def test_the_newest_version_in_the_fuel_cache_counts(
    form: str, house: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    models = tmp_path / "cache" / "fuel.gazebosim.org" / "shop" / "models" / "officechair"
    for version, sides in (("2", "2 2 2"), ("10", "5 5 5"), ("9", "9 9 9")):
        model_file(models, version, LINK.replace("1 2 3", sides))
    monkeypatch.setenv("GZ_FUEL_CACHE_PATH", str(tmp_path / "cache"))
    if form == "named in a building":
        sizes = [(read_rmf(house), 5)]
    else:
        url = "<include><name>c</name><uri>https://fuel.gazebosim.org/1.0/Shop/models/OfficeChair{}</uri></include>"
        sizes = [
            (read_world(world_file(tmp_path, url.format(version))), size)
            for version, size in (("", 5), ("/2", 2), ("/tip", 5))
        ]
    for world, size in sizes:
        assert world.skipped == []
        shapes = [
            e.shapes[0] for e in world.entries if e.kind == "object" and "model" in e.properties
        ]
        assert {round(float(np.ptp(s.mesh.bounds[:, 0])), 6) for s in shapes} == {size}


def test_a_broken_model_is_named_and_keeps_its_place(house: Path, tmp_path: Path) -> None:
    file = model_file(tmp_path / "library", "OfficeChair", LINK)
    file.write_text("<sdf><model")
    world = read_rmf(house, model_path=[tmp_path / "library"])
    (skipped,) = world.skipped
    assert "OfficeChair" in skipped.element
    assert "cannot be used" in skipped.problem
    assert len([e for e in world.entries if e.type == "office_chair"]) == 4


@pytest.mark.parametrize("name", ["..", ".", "/", "*", "a\\u0000b", "x" * 5000, "models/7"])
def test_odd_names_find_no_model(name: str, house: Path, tmp_path: Path, monkeypatch) -> None:
    model_file(tmp_path / "cache" / "a" / "b" / "models" / "x", "1", LINK)
    monkeypatch.setenv("GZ_FUEL_CACHE_PATH", str(tmp_path / "cache"))
    house.write_text(
        house.read_text().replace("model_name: Shop/OfficeChair", f'model_name: "{name}"')
    )
    world = read_rmf(house)
    assert not any(e.shapes for e in world.entries if e.properties.get("model"))
