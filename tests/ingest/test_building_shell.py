"""Buildings in one mesh, whatever their names; the rooms in them are those of the plan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from shapely import Polygon, box

import semmap
from semmap.ingest.building_shell import recognise_shells
from semmap.ingest.importer import read_world

ROOMS = [box(0, 0, 5, 4), box(5.2, 0, 9, 4), box(0, 4.2, 9, 8)]
AROUND = box(-0.2, -0.2, 9.2, 8.2)
DOORS = [box(4.9, 1, 5.3, 1.9), box(2, 3.9, 2.9, 4.3), box(-0.3, 6, 0.1, 6.9)]
TALL, LINTEL = 2.7, 2.1


def built(area: shapely.Geometry, low: float, high: float) -> list[trimesh.Trimesh]:
    parts = [part for part in getattr(area, "geoms", [area]) if isinstance(part, Polygon)]
    return [
        trimesh.creation.extrude_polygon(part, high - low, engine="earcut").apply_translation(
            (0, 0, low)
        )
        for part in parts
        if part.area > 1e-4
    ]


def building(slab: float, storeys: int) -> trimesh.Trimesh:
    """Walls with doorways, and a slab below each storey, as one mesh."""
    solid = AROUND.difference(shapely.union_all(ROOMS))
    gaps = shapely.union_all(DOORS)
    parts = []
    for number in range(storeys):
        floor = number * (TALL + slab)
        parts += built(AROUND, floor - slab, floor)
        parts += built(solid.difference(gaps), floor, floor + TALL)
        parts += built(solid.intersection(gaps), floor + LINTEL, floor + TALL)
    made = trimesh.util.concatenate(parts)
    assert isinstance(made, trimesh.Trimesh)
    return made


def block(x: float, y: float, z: float, *size: float) -> trimesh.Trimesh:
    return trimesh.creation.box(size).apply_translation((x, y, z + size[2] / 2))


def written(folder: Path, parts: Sequence[tuple[str, trimesh.Trimesh]]) -> Path:
    scene = trimesh.Scene()
    upright = trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0))  # a GLB has y up
    for name, mesh in parts:
        scene.add_geometry(mesh.copy().apply_transform(upright), node_name=name, geom_name=name)
    scene.export(folder / "scene.glb")
    return folder / "scene.glb"


FURNITURE = [("table", block(2, 2, 0, 1.2, 0.8, 0.75)), ("bed", block(7, 2, 0, 2, 1.4, 0.5))]


@pytest.mark.parametrize("name", ["Node0", "building", "hospital", "hospital_shell"])
@pytest.mark.parametrize(("slab", "storeys"), [(0.1, 1), (0.3, 1), (0.1, 2), (0.3, 2)])
def test_rooms_are_found_in_a_building_of_one_mesh(
    name: str, slab: float, storeys: int, tmp_path: Path, database: str
) -> None:
    upstairs = [
        (f"upper_{each}", mesh.copy().apply_translation((0, 0, TALL + slab)))
        for each, mesh in FURNITURE
    ]
    more = upstairs if storeys > 1 else []
    path = written(tmp_path, [(name, building(slab, storeys)), *FURNITURE, *more])
    with semmap.connect(database) as db:
        db.import_file(path, map="one")
        made = db.map("one")
        assert made.objects[name].type == "building_shell"
        assert made.objects["table"].type == "table"
        found = made.find_rooms()
        db.drop_map("one")
    assert len(found) == storeys
    for storey in found:
        assert len(storey.rooms) == len(ROOMS)
        for room in ROOMS:
            shared = max(
                room.intersection(r.outline).area / room.union(r.outline).area for r in storey.rooms
            )
            assert shared > 0.9
        assert [way.height for way in storey.doorways] == [LINTEL] * len(DOORS)


RACK = [block(x, y, 0, 0.1, 0.1, 4) for x in (0, 3, 6, 9) for y in (0, 4)] + [
    block(4.5, 2, z, 9.1, 4.1, 0.05) for z in (0.2, 1.6, 3.0)
]


@pytest.mark.parametrize(
    ("name", "mesh", "inside"),
    [
        ("Node0", trimesh.util.concatenate(RACK), block(4, 2, 0.25, 1, 0.8, 0.8)),  # a rack
        ("Node0", block(4.5, 4, 0, 9, 8, 3), block(4, 4, 3, 1, 0.8, 0.8)),  # solid, loaded
        ("Node0", building(0.2, 1), block(14, 2, 0, 1, 0.8, 0.8)),  # nothing is inside
        ("bus", building(0.2, 1), block(2, 2, 0, 1, 0.8, 0.8)),  # a name that says more
    ],
)
def test_other_objects_are_no_buildings(
    name: str, mesh: trimesh.Trimesh, inside: trimesh.Trimesh, tmp_path: Path
) -> None:
    world = read_world(written(tmp_path, [(name, mesh), ("Node1", inside)]))
    before = {entry.name: entry.type for entry in world.entries}
    recognise_shells(world.entries)
    assert {entry.name: entry.type for entry in world.entries} == before


def test_a_stated_type_stays(tmp_path: Path) -> None:
    world = read_world(written(tmp_path, [("Node0", building(0.2, 1)), *FURNITURE]))
    shell = next(entry for entry in world.entries if entry.name == "Node0")
    for before, after in (("sculpture", "sculpture"), (None, "building_shell")):
        shell.type = before
        recognise_shells(world.entries)
        assert shell.type == after
