"""SDF worlds that tests write, and the parts of what is read from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from semmap.geometry.mesh import Mesh
from semmap.ingest.sdf.world_file import read_sdf
from semmap.ingest.world import Entry, World

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 4 3\nf 1 2 4\nf 2 3 4\n"
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], float)
MESH = "<geometry><mesh><uri>{}</uri></mesh></geometry>"
BOX = "<geometry><box><size>{}</size></box></geometry>"
VISUAL = f'<visual name="v">{BOX.format("1 2 3")}</visual>'
LINK = f'<link name="base">{VISUAL}</link>'


def world_file(folder: Path, inside: str, name: str = "default", version: str = "1.9") -> Path:
    path = folder / "test.world"
    path.write_text(f'<sdf version="{version}"><world name="{name}">{inside}</world></sdf>')
    return path


def model_file(folder: Path, name: str, inside: str) -> Path:
    """A model folder below `folder`, with a tetrahedron as its mesh."""
    (folder / name / "meshes").mkdir(parents=True)
    (folder / name / "meshes" / "solid.obj").write_text(TETRAHEDRON)
    path = folder / name / "model.sdf"
    path.write_text(f'<sdf version="1.9"><model name="{name}">{inside}</model></sdf>')
    return path


def entry(world: World, name: str) -> Entry:
    return next(e for e in world.entries if e.name == name)


def surface(world: World, name: str) -> Mesh:
    """The one mesh of an entry, in the world's frame."""
    found = entry(world, name)
    (shape,) = found.shapes
    assert found.pose is not None
    assert shape.mesh is not None
    return shape.mesh.moved(found.pose)


def read(folder: Path, inside: str, **options: Any) -> World:
    return read_sdf(world_file(folder, inside), **options)


def volume(mesh: Mesh) -> float:
    return float(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume)


def at(pose: str, name: str = "m", **attributes: str) -> str:
    written = "".join(f' {k}="{v}"' for k, v in attributes.items())
    return f'<model name="{name}"><pose{written}>{pose}</pose>{LINK}</model>'
