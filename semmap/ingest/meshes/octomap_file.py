"""OctoMap files, .bt and .ot: occupied voxels as a closed surface.

Source: Hornung et al., "OctoMap", 2013, section 3.5.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh, voxel_mesh
from semmap.ingest.meshes.mesh_size import MeshFileError
from semmap.limits import TRIANGLES

DEPTH = 16
"""Of the tree: its root has 2^16 voxels along each axis, around the origin of the map."""

FREE, OCCUPIED, INNER = 1, 2, 3
"""The two bits of a child in a .bt file; 0 is an unknown child."""

Leaf = tuple[int, int, int, int]
"""Lowest voxel x, y, z and edge, in voxels."""


@dataclass(frozen=True)
class _Header:
    binary: bool  # two bits a child, as in .bt files
    nodes: int
    resolution: float
    data: bytes


def read_octomap(path: Path) -> Mesh:
    """Return the outward faces between occupied voxels and others of an OctoMap file, metres.

    It is a .bt (occupied, free, unknown) or .ot (log-odds; occupied above 0). A ValueError refuses
    a damaged file or one without an occupied voxel.
    """
    header = _read_header(path.read_bytes())
    voxels = _voxels(list(_leaves(header)))
    if not len(voxels):
        raise ValueError("no voxel is occupied")
    mesh = voxel_mesh(voxels)
    return Mesh(mesh.vertices * header.resolution, mesh.faces)


def _read_header(content: bytes) -> _Header:
    head, found, data = content.partition(b"\ndata\n")
    lines = head.decode("ascii", "replace").splitlines()
    if not found or not lines or not lines[0].lower().startswith("# octomap octree"):
        raise ValueError("it does not begin with '# Octomap OcTree'")
    pairs = (line.partition(" ") for line in lines[1:] if not line.startswith("#"))
    values = {key: value.strip() for key, _, value in pairs}
    if values.get("id") not in ("OcTree", "1"):
        raise ValueError(f"its trees are of type {values.get('id')}: only OcTree is read")
    nodes, resolution = int(values.get("size", "-1")), float(values.get("res", "nan"))
    if not (math.isfinite(resolution) and resolution > 0 and nodes >= 0):
        raise ValueError(f"its resolution is {resolution} m and its size {nodes} nodes")
    return _Header("binary" in lines[0].lower(), nodes, resolution, data)


def _leaves(header: _Header) -> Iterator[Leaf]:
    """Yield the occupied leaves of a file: two bits a child, or log-odds and a bit a child."""
    half = 1 << (DEPTH - 1)
    todo: list[Leaf] = [(-half, -half, -half, 2 * half)] if header.nodes else []
    record = struct.Struct("<H" if header.binary else "<fB")
    for start in range(0, len(header.data) - record.size + 1, record.size):
        if not todo:
            return
        cube = todo.pop()
        values = record.unpack_from(header.data, start)
        if header.binary:
            states = [(values[0] >> 2 * i & 3, child) for i, child in enumerate(_children(cube))]
            yield from (child for state, child in states if state == OCCUPIED)
            inner = [child for state, child in states if state == INNER]
        else:
            log_odds, bits = values
            inner = [child for i, child in enumerate(_children(cube)) if bits >> i & 1]
            if log_odds > 0 and not bits:
                yield cube
        if inner and inner[0][3] < (2 if header.binary else 1):
            raise ValueError(f"its tree is deeper than {DEPTH} levels")
        todo.extend(reversed(inner))
    if todo:
        raise ValueError("it ends before its last node")


def _children(cube: Leaf) -> Iterator[Leaf]:
    """Yield the eight halves of a cube, x fastest and z slowest."""
    x, y, z, edge = cube
    half = edge // 2
    for i in range(8):
        yield x + (i & 1) * half, y + (i >> 1 & 1) * half, z + (i >> 2 & 1) * half, half


def _voxels(leaves: list[Leaf]) -> NDArray[np.int64]:
    """(N, 3) the lowest corners of all voxels of some leaves."""
    count = sum(edge**3 for *_, edge in leaves)
    TRIANGLES.check(12 * count, MeshFileError, "Write it with a larger res.", "may have")
    by_edge: dict[int, list[tuple[int, int, int]]] = {}
    for x, y, z, edge in leaves:
        by_edge.setdefault(edge, []).append((x, y, z))
    parts = [np.empty((0, 3), np.int64)]
    for edge, corners in by_edge.items():
        inside = np.indices((edge, edge, edge)).reshape(3, -1).T
        parts.append((np.array(corners)[:, None] + inside).reshape(-1, 3))
    return np.concatenate(parts)
