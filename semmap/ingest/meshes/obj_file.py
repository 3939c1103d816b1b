"""Wavefront OBJ files, by their objects and groups."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from semmap.geometry.mesh import Mesh
from semmap.ingest.meshes.mesh_size import SIMPLER, MeshFileError, check_size
from semmap.limits import PARTS, TRIANGLES


def read_obj(path: Path) -> list[tuple[int | str, tuple[str, str], Mesh]]:
    """Return the pieces of an OBJ file: the node, the names of object and group, and the surface.

    Each `o` is a node; where the file has none, each name of a `g` is. Materials divide nothing.
    Polygons become fans of triangles. trimesh's loader joins objects of one name, and takes
    vertices that are counted backwards from a face (negative indices) from the end of the file.
    """
    check_size(path)
    vertices = array("d")
    pieces: dict[tuple[int, str, str], array[int]] = {}
    number, name, group, triangles = 0, "", "", 0
    faces: array[int] | None = None
    most = TRIANGLES.value
    for words, line in _statements(path):
        if words[0] == "v":
            vertices.extend(map(float, words[1:4]))
        elif words[0] == "f":
            if faces is None:
                faces = pieces.setdefault((number, name, group), array("q"))
                PARTS.check(len(pieces), MeshFileError, SIMPLER)
            count = len(vertices) // 3
            indices = [int(word.partition("/")[0]) for word in words[1:]]  # of 3/1/2, the vertex
            first, *others = [i - 1 if i > 0 else i + count for i in indices]
            for second, third in pairwise(others):
                faces.extend((first, second, third))
                triangles += 1
            if triangles > most:
                TRIANGLES.check(triangles, MeshFileError, SIMPLER)
        elif words[0] == "o":
            number, name, group, faces = number + 1, line.strip()[1:].strip(), "", None
        elif words[0] == "g":
            group, faces = line.strip()[1:].strip(), None
    points = np.array(vertices).reshape(-1, 3)
    found = []
    for (number_, name_, group_), corners in pieces.items():
        used, index = np.unique(np.array(corners, np.int64), return_inverse=True)
        if len(used) and (used[0] < 0 or used[-1] >= len(points)):
            problem = "its faces name vertices that it does not have"
            raise MeshFileError(problem, "Export it again.")
        mesh = Mesh(points[used], index.reshape(-1, 3).astype(np.int32))
        found.append((number_ if number else group_, (name_, group_), mesh))
    return found


def _statements(path: Path) -> Iterator[tuple[list[str], str]]:
    """Yield the words of each line and the line; a backslash continues one on the next."""
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            while line.endswith("\\\n"):
                line = line[:-2] + " " + next(file, "")
            if words := line.split():
                yield words, line
