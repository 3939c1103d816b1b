"""Regions of too many voxels are refused before memory or time is spent; the others stay."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
import shapely
from sqlalchemy import Engine

from semmap.database.files import schema_folder
from semmap.fields import Box, RegionMap, Sphere
from semmap.fields.maps.vocabulary import read_vocabulary
from semmap.fields.regions.region_text import read_region
from semmap.fields.regions.shaped_region import Region, Solid, SurfaceRegion
from semmap.fields.sources import Zone, Zones, ZoneSource
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.geometry.mesh import Mesh, box_mesh
from semmap.ingest.importer import import_file
from tests.command_line import semmap
from tests.fields.sources.test_sources import NOW
from tests.oracles.region_map import check_region_map

SIZE = 0.05
GIANT = box_mesh((-4999.5,) * 3, (4999.5,) * 3)
CORNERS = np.random.default_rng(1).uniform(-1e7, 1e7, (9, 3))


def solid(mesh: Mesh) -> Solid:
    return Solid(mesh.vertices, mesh.faces)


TOO_LARGE: dict[str, Region] = {
    "a solid of 9,999 m": solid(GIANT),
    "its surface": SurfaceRegion(GIANT.vertices, GIANT.faces),
    "a box of 9,999 m": Box((0, 0, 0), (9999, 9999, 9999)),
    "a hall of 200 x 200 x 6 m": Box((0, 0, 0), (200, 200, 6)),
    "the same as a solid": solid(box_mesh((0, 0, 0), (200, 200, 6))),
    "a needle of 100 km": read_region("CYLINDER(0 1e5 0 0.3 1e5)"),
    "one that lies across": read_region("CYLINDER(0 0 0 0.3 1e5 1 1 0)"),
    "a thin one": read_region("CYLINDER(0 0 0 0.001 1e4 1 1 1)"),
    "a disc": read_region("CYLINDER(0 0 0 1e4 0)"),
    "a hull of 1e7 m": read_region(
        "HULL(" + ", ".join(" ".join(map(str, c)) for c in CORNERS) + ")"
    ),
    "a flat hull": read_region("HULL(0 0 0, 1e7 0 0, 0 1e7 1, 1e7 1e7 1)"),
    "a ball of 1 km": Sphere((0, 0, 0), 1000),
    "a cone as wide as the world": read_region("CONE(0 0 0 0 0 1 3.1415 100)"),
    "beyond all indices": Sphere((1e12, 0, 0), 1),
    "points too far apart": np.random.default_rng(2).uniform(-1e4, 1e4, (5000, 3)),
}


@pytest.mark.parametrize("name", TOO_LARGE)
def test_a_region_that_is_too_large_is_refused_in_time(name: str) -> None:
    regions = RegionMap(SIZE)
    start = time.process_time()
    with pytest.raises(ValueError, match=r"thing: .*take|thing: .*nearer"):
        regions.insert("thing", TOO_LARGE[name])
    assert time.process_time() - start < 5
    assert len(regions) == 0
    check_region_map(regions._native)


def test_a_variable_raises_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    regions = RegionMap(SIZE)
    regions.insert("hall", Box((0, 0, 0), (20, 20, 3)))
    monkeypatch.setenv("SEMMAP_MAX_REGION_VOXELS", "1e6")
    with pytest.raises(ValueError, match=r"more than 1000000 voxels.*SEMMAP_MAX_REGION_VOXELS"):
        regions.insert("other", Box((0, 0, 0), (10, 10, 12)))
    with pytest.raises(ValueError, match=r"too many columns.*SEMMAP_MAX_REGION_VOXELS"):
        regions.insert("other", Box((0, 0, 0), (20, 20, 0.1)))
    monkeypatch.setenv("SEMMAP_MAX_REGION_VOXELS", "1e8")
    monkeypatch.setenv("SEMMAP_MAX_REGION_BLOCKS", "10")
    with pytest.raises(ValueError, match="SEMMAP_MAX_REGION_BLOCKS"):
        regions.insert("other", Sphere((0, 0, 0), 3))
    monkeypatch.delenv("SEMMAP_MAX_REGION_BLOCKS")
    regions.insert("other", Sphere((0, 0, 0), 3))


def test_many_regions_are_inserted_all_or_without_those_too_large() -> None:
    pairs: list[tuple[str, Region]] = [
        ("mug", Box((0, 0, 0), (0.1, 0.1, 0.1))),
        ("giant", Box((1, 0, 0), (0.1, 0.1, 0.1))),
        ("giant", solid(GIANT)),
        ("table", Box((2, 0, 0), (1, 1, 1))),
    ]
    regions = RegionMap(SIZE)
    with pytest.raises(ValueError, match=r"^giant: the region spans"):
        regions.insert_many(pairs)
    assert len(regions) == 0
    left_out = regions.insert_possible(pairs)
    assert left_out.keys() == {"giant"}
    assert regions.entities() == {"mug", "table"}
    check_region_map(regions._native)


def test_a_zone_that_is_too_large_is_left_out() -> None:
    source = ZoneSource(read_vocabulary([schema_folder() / "ontology" / "fields.ttl"]))
    zones = (
        Zone("desert", "room", shapely.box(0, 0, 9999, 9999), 0, 100),
        Zone("kitchen", "room", shapely.box(0, 0, 3, 3), 0, 2),
    )
    for _ in range(2):
        assert [each.about for each in source(Zones(zones, NOW))] == ["kitchen"]
        assert "take larger voxels" in source.left_out["desert"]
    source(Zones(zones[1:], NOW))
    assert source.left_out == {}


def world(path: Path, size: float) -> Path:
    models = "".join(
        f"<model name='{name}'><pose>{x} 0 0 0 0 0</pose><link name='l'><visual name='v'><geometry>"
        f"<box><size>{size} {size} {size}</size></box></geometry></visual></link></model>"
        for name, x, size in (("giant", 20, size), ("mug", 0, 0.2))
    )
    path.write_text(f"<sdf version='1.7'><world name='w'>{models}</world></sdf>")
    return path


def test_the_mirror_names_an_entity_that_is_too_large(engine: Engine, tmp_path: Path) -> None:
    path = world(tmp_path / "w.sdf", 9999)
    import_file(engine, path)
    mirror = VoxelMirror(engine, voxel_size=SIZE)
    mirror.catch_up()
    assert [*mirror.names.values()] == ["mug"]
    assert "take larger voxels" in mirror.left_out["giant"]
    mirror.save()
    again = VoxelMirror.resume(engine, voxel_size=SIZE)
    again.catch_up()
    assert again.left_out == mirror.left_out
    import_file(engine, world(path, 1))
    again.catch_up()
    assert sorted(again.names.values()) == ["giant", "mug"]
    assert again.left_out == {}


def test_the_command_names_an_entity_that_is_too_large(
    database: str, engine: Engine, tmp_path: Path
) -> None:
    import_file(engine, world(tmp_path / "w.sdf", 9999))
    done = semmap(database, "fields", "ls", "--json")
    assert done.exit_code == 0
    assert '"mug"' in done.stdout
    assert "giant" not in done.stdout
    assert "left out: giant: the region spans too many columns" in done.stderr
