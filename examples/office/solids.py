"""Solids of boxes, prisms and turned profiles, and the mesh files that they are written to."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import shapely
import trimesh
from numpy.typing import ArrayLike, NDArray

Solid = trimesh.Trimesh


def box(size: Sequence[float], middle: Sequence[float]) -> Solid:
    """A box; `middle` is that of its base, so that heights read from the floor up."""
    x, y, z = middle
    return _placed(trimesh.creation.box(extents=size), (x, y, z + size[2] / 2))


def cylinder(radius: float, height: float, base: Sequence[float], sides: int = 20) -> Solid:
    """An upright cylinder on `base`."""
    x, y, z = base
    solid = trimesh.creation.cylinder(radius=radius, height=height, sections=sides)
    return _placed(solid, (x, y, z + height / 2))


def turned(profile: Sequence[tuple[float, float]], sides: int = 20) -> Solid:
    """A profile of (radius, height) pairs, turned about the z axis; it begins and ends at 0."""
    return trimesh.creation.revolve(np.array(profile), sections=sides)


def ball(radius: float, middle: Sequence[float]) -> Solid:
    """A coarse ball."""
    return _placed(trimesh.creation.icosphere(subdivisions=2, radius=radius), middle)


def prism(outline: shapely.Polygon, low: float, high: float) -> Solid:
    """An outline, holes allowed, extruded from z `low` to `high`."""
    solid = trimesh.creation.extrude_polygon(outline, high - low, engine="earcut")
    return _placed(solid, (0, 0, low))


def together(*solids: Solid) -> Solid:
    """Several solids as one mesh; where they touch, both surfaces stay."""
    return trimesh.util.concatenate(solids)


def without(solid: Solid, holes: Sequence[Solid]) -> Solid:
    """A solid with holes cut out of it."""
    return trimesh.boolean.difference([solid, *holes], engine="manifold")


def legs(length: float, width: float, height: float, thick: float, inset: float) -> Solid:
    """Four square legs under a top of this size."""
    x, y = length / 2 - inset - thick / 2, width / 2 - inset - thick / 2
    return together(
        *(box((thick, thick, height), (i * x, j * y, 0)) for i in (-1, 1) for j in (-1, 1))
    )


def _placed(solid: Solid, at: Sequence[float]) -> Solid:
    solid.apply_translation(at)
    return solid


# -- files ------------------------------------------------------------------------------------


def write(solid: Solid, path: Path) -> None:
    """Write a mesh in the format that the file's ending says."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(WRITERS[path.suffix](*_tidy(solid)))


def _tidy(solid: Solid) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices to 10 micrometres, in order, each once: the same bytes at each run."""
    vertices, inverse = np.unique(
        np.round(solid.vertices, 5) + 0.0, axis=0, return_inverse=True
    )  # + 0.0 makes -0.0 to 0.0
    faces = inverse.reshape(-1)[solid.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    turns = faces.argmin(axis=1)
    faces = np.take_along_axis(faces, (turns[:, None] + np.arange(3)) % 3, axis=1)
    return vertices, faces[np.lexsort(faces.T[::-1])]


def _obj(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bytes:
    lines = [f"v {_numbers(v)}" for v in vertices]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    return ("\n".join(lines) + "\n").encode()


def _stl(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bytes:
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(faces), dtype=[("f", "<f4", (4, 3)), ("attribute", "<u2")])
    records["f"][:, 0], records["f"][:, 1:] = normals, corners
    header = b"binary STL, metres".ljust(80)
    return header + struct.pack("<I", len(faces)) + records.tobytes()


def _dae(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bytes:
    """COLLADA in centimetres, as modelling programs write it."""
    centimetres = _numbers(100 * vertices)
    return f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset>
    <created>2025-01-01T00:00:00</created>
    <modified>2025-01-01T00:00:00</modified>
    <unit name="centimeter" meter="0.01"/>
    <up_axis>Z_UP</up_axis>
  </asset>
  <library_geometries>
    <geometry id="shape" name="shape">
      <mesh>
        <source id="shape-positions">
          <float_array id="shape-array" count="{vertices.size}">{centimetres}</float_array>
          <technique_common>
            <accessor source="#shape-array" count="{len(vertices)}" stride="3">
              <param name="X" type="float"/>
              <param name="Y" type="float"/>
              <param name="Z" type="float"/>
            </accessor>
          </technique_common>
        </source>
        <vertices id="shape-vertices">
          <input semantic="POSITION" source="#shape-positions"/>
        </vertices>
        <triangles count="{len(faces)}">
          <input semantic="VERTEX" source="#shape-vertices" offset="0"/>
          <p>{" ".join(map(str, faces.ravel()))}</p>
        </triangles>
      </mesh>
    </geometry>
  </library_geometries>
  <library_visual_scenes>
    <visual_scene id="scene">
      <node id="node" name="shape">
        <instance_geometry url="#shape"/>
      </node>
    </visual_scene>
  </library_visual_scenes>
  <scene>
    <instance_visual_scene url="#scene"/>
  </scene>
</COLLADA>
""".encode()


def _glb(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bytes:
    """glTF, which has y up: a vertex (x, y, z) is written as (x, z, -y)."""
    y_up = vertices[:, [0, 2, 1]] * (1, 1, -1)
    solid = trimesh.Trimesh(y_up, faces, process=False)
    data: bytes = solid.export(file_type="glb", include_normals=False)
    return data


def _numbers(values: ArrayLike) -> str:
    return " ".join(f"{v:.5f}".rstrip("0").rstrip(".") for v in np.ravel(values))


WRITERS: dict[str, Callable[[NDArray[np.float64], NDArray[np.int64]], bytes]] = {
    ".obj": _obj,
    ".stl": _stl,
    ".dae": _dae,
    ".glb": _glb,
}

STAR = [i * 2 * math.pi / 5 for i in range(5)]
"""Directions of the feet of an office chair."""
