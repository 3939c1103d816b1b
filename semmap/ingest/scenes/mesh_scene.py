"""A mesh file with named nodes (GLB, glTF, COLLADA, OBJ) as a scene."""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.extent import extent
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.annotation.feature_file import checked_properties
from semmap.ingest.meshes.mesh_file import MeshPart, mesh_parts
from semmap.ingest.meshes.mesh_size import MeshFileError
from semmap.ingest.scenes.scene_nodes import SceneNode, rigid_pose, scene_world
from semmap.ingest.world import Entry, Refused, World, WorldError

FURNITURE = 4.0
"""Metres across what may be one object of several nodes; what is larger is a scene."""

LEANS = 1e-3
"""Radians within which an axis of a node is vertical, level, or at a right angle to another."""

STATED = ("storey", "room", "region", "object", "agent")
"""The kinds of an export of semmap that come back: storeys, and those that have surfaces."""


def is_mesh_scene(path: Path, *, scale: float = 1.0) -> bool:
    """Return whether a mesh file has several named nodes that are more than a piece of furniture.

    `scale` is as of `read_mesh_scene`. A file that cannot be used is none.
    """
    try:
        nodes = [node for node in _nodes(path, scale) if node.meshes]
    except MeshFileError:
        return False
    corners = np.array([corner for node in nodes for m in node.meshes for corner in m.bounds])
    return len(nodes) > 1 and bool(np.ptp(corners, axis=0).max() > FURNITURE)


def read_mesh_scene(
    path: Path, *, scale: float = 1.0, types: Collection[str] | None = None
) -> World:
    """Return an object for each node with a mesh; its frame is below the middle of its box.

    It has the heading of the node's x axis where one axis of the node is vertical. The nearest node
    above it that has a mesh, too, holds it. Of an export of semmap, kinds, types, labels,
    properties and frames are those that it states; a type that is none of `types` is noted and left
    out.

    `scale` is metres per unit of a format without units. A WorldError refuses a file that cannot be
    used.
    """
    try:
        world = scene_world(path, _nodes(path, scale))
    except MeshFileError as error:
        raise WorldError(path, "mesh", error.problem, error.fix) from error
    for entry in world.entries:
        if types is not None and entry.type is not None and entry.type not in types:
            problem = f"its type {entry.type!r} is none that the map has"
            world.notes.append(f"{entry.name}: {problem}; --define (define=True) adds it")
            entry.type = None
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
    """The nodes with a surface, and the storeys that are stated, each after those above it."""
    parts = [part for part in mesh_parts(path) if len(part.mesh.faces) or _is_storey(part)]
    meshes: dict[Hashable, list[Mesh]] = {part.node: [] for part in parts}
    for part in parts:
        if len(part.mesh.faces):
            meshes[part.node].append(Mesh(scale * part.mesh.vertices, part.mesh.faces))
    of_node = {part.node: part for part in reversed(parts)}
    made: dict[Hashable, SceneNode] = {}
    for node in sorted(meshes, key=lambda node: len(of_node[node].above)):
        part = of_node[node]
        made[node] = SceneNode(part.names[0], IDENTITY, meshes[node], stated=_stated(part.extras))
        made[node].pose = _frame(made[node], part.frame, scale)
        made[node].above = next((made[above] for above in part.above if above in made), None)
    return list(made.values())


def _is_storey(part: MeshPart) -> bool:
    stated = _stated(part.extras)
    is_placed = part.frame is not None and bool(np.isfinite(part.frame).all())
    return is_placed and stated is not None and stated.kind == "storey"


def _frame(node: SceneNode, matrix: NDArray[np.float64] | None, scale: float) -> Pose:
    """Return the frame of a node: of one that semmap wrote its own, else one below its box.

    `matrix` (4, 4) is the node's transform to the map, None where the format has none.
    """
    if matrix is None or not np.isfinite(matrix).all():
        turn = IDENTITY
    elif node.stated is not None:
        pose = rigid_pose(matrix)
        return pose._replace(x=scale * pose.x, y=scale * pose.y, z=scale * pose.z)
    else:
        turn = Pose.planar(0.0, 0.0, _heading(matrix[:3, :3]))
    inside = turn.inverse()
    corners = np.array([extent(inside.apply(mesh.vertices)) for mesh in node.meshes])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    x, y = ((low + high) / 2)[:2].tolist()
    return turn @ Pose(x, y, float(low[2]))


def _heading(axes: NDArray[np.float64]) -> float:
    """Return the heading of a node of which one axis is vertical: that of its x axis; else 0.

    `axes` (3, 3) are the columns of its transform, which may scale and mirror. A node whose x axis
    is the vertical one has the heading of its y axis, a sheared one none.
    """
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(axes, axis=0)
    if not (lengths.all() and np.isfinite(lengths).all()):
        return 0.0
    axes = axes / lengths
    level = np.flatnonzero(np.abs(axes[2]) < LEANS)
    if len(level) != 2 or np.abs(axes.T @ axes - np.eye(3)).max() > LEANS:
        return 0.0
    return math.atan2(axes[1, level[0]], axes[0, level[0]])


def _stated(extras: Mapping[str, Any]) -> Entry | None:
    """Return what an export of semmap says of a node; None of other nodes."""
    kind, type_, label = (extras.get(key) for key in ("kind", "type", "label"))
    free = extras.get("properties", {})
    if kind not in STATED or not isinstance(free, dict):
        return None
    if not all(isinstance(each, str | None) for each in (type_, label)):
        return None
    try:
        checked_properties({**free, "type": type_, "label": label})
    except Refused:
        return None
    return Entry("", kind, type_, label, free)
