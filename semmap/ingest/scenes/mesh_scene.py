"""A mesh file with named nodes (GLB, glTF, COLLADA, OBJ) as a scene."""

from __future__ import annotations

from collections.abc import Hashable
from pathlib import Path

import numpy as np

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.ingest.meshes.mesh_file import mesh_parts
from semmap.ingest.meshes.mesh_size import MeshFileError
from semmap.ingest.scenes.scene_nodes import SceneNode, scene_world
from semmap.ingest.world import Entry, World, WorldError

FURNITURE = 4.0
"""Metres across what may be one object of several nodes; what is larger is a scene."""


def is_mesh_scene(path: Path, *, scale: float = 1.0) -> bool:
    """Return whether a mesh file has several named nodes that are more than a piece of furniture.

    `scale` is as of `read_mesh_scene`. A file that cannot be used is none.
    """
    try:
        nodes = _nodes(path, scale)
    except MeshFileError:
        return False
    corners = np.array([corner for node in nodes for m in node.meshes for corner in m.bounds])
    return len(nodes) > 1 and bool(np.ptp(corners, axis=0).max() > FURNITURE)


def read_mesh_scene(path: Path, *, scale: float = 1.0) -> World:
    """Return an object for each node with a mesh; its frame is below the middle of its box.

    The nearest node above it that has a mesh, too, holds it.

    `scale` is metres per unit of a format without units. A WorldError refuses a file that cannot be
    used.
    """
    try:
        world = scene_world(path, _nodes(path, scale))
    except MeshFileError as error:
        raise WorldError(path, "mesh", error.problem, error.fix) from error
    if lying := [entry.name for entry in world.entries if _is_lying_wall(entry)]:
        world.notes.append(f"{lying[0]} lies: if y is up in {path.name}, export it with z up")
    return world


def _is_lying_wall(entry: Entry) -> bool:
    """Whether something is a wall by its name, and a slab by its shape."""
    if entry.type != "wall" or not entry.shapes or entry.shapes[0].mesh is None:
        return False
    x, y, z = np.ptp(entry.shapes[0].mesh.bounds, axis=0)
    return bool(3 * z < min(x, y))


def _nodes(path: Path, scale: float) -> list[SceneNode]:
    """The nodes with a surface, each after those above it."""
    parts = [part for part in mesh_parts(path) if len(part.mesh.faces)]
    meshes: dict[Hashable, list[Mesh]] = {part.node: [] for part in parts}
    for part in parts:
        meshes[part.node].append(Mesh(scale * part.mesh.vertices, part.mesh.faces))
    of_node = {part.node: part for part in reversed(parts)}
    made: dict[Hashable, SceneNode] = {}
    for node in sorted(meshes, key=lambda node: len(of_node[node].above)):
        part = of_node[node]
        made[node] = _node(part.names[0], meshes[node])
        made[node].above = next((made[above] for above in part.above if above in made), None)
    return list(made.values())


def _node(name: str, meshes: list[Mesh]) -> SceneNode:
    low = [min(float(m.vertices[:, k].min()) for m in meshes) for k in range(3)]
    high = [max(float(m.vertices[:, k].max()) for m in meshes) for k in range(3)]
    x, y = ((low[k] + high[k]) / 2 for k in range(2))
    return SceneNode(name, Pose(x, y, low[2]), meshes)
