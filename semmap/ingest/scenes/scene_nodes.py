"""Named nodes of a scene as entries: an object for each node that has a surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.ground_outline import silhouette
from semmap.geometry.mesh import Mesh, join, prism_mesh
from semmap.geometry.pose import Pose
from semmap.ingest.annotation.annotation import ROOM_HEIGHT
from semmap.ingest.meshes.mesh_file import checked, tidy
from semmap.ingest.meshes.mesh_size import SIMPLER, MeshFileError
from semmap.ingest.naming import give_type
from semmap.ingest.world import (
    Entry,
    PlaceDetail,
    Shape,
    Skipped,
    StoreyDetail,
    World,
    WorldError,
    WorldLink,
    unique_name,
)
from semmap.limits import EXTENT, TRIANGLES

JOINTED = "jointed_to"
"""The relation of what moves on a joint to the object against which it moves."""


@dataclass(frozen=True)
class SceneJoint:
    """How a node moves against the node above it; `point` and `axis` are in its own frame.

    The type is one of URDF; limits are radians or metres, None where there are none.
    """

    type: str
    point: tuple[float, float, float]
    axis: tuple[float, float, float]
    lower: float | None
    upper: float | None

    def seen_from(self, pose: Pose) -> SceneJoint:
        """Return the joint, given in a frame of this pose, in the frame around it."""
        x, y, z = pose.apply([self.point])[0].tolist()
        dx, dy, dz = (pose.rotation_matrix @ self.axis).tolist()
        return replace(self, point=(x, y, z), axis=(dx, dy, dz))


@dataclass(eq=False)
class SceneNode:
    """A node: its name, its pose, its surfaces, and the node above it.

    Pose and surfaces are in the map's frame, metres, z up. `lost`: it has surfaces in the file that
    cannot be used, so that it is an object also without one. `stated` has kind, type, label and
    properties of one of which the file states them; else it is an object, its type is guessed.
    Without a `joint`, it is fixed to the node above it.
    """

    name: str
    pose: Pose
    meshes: list[Mesh] = field(default_factory=list)
    above: SceneNode | None = None
    lost: bool = False
    stated: Entry | None = None
    joint: SceneJoint | None = None


def scene_world(
    path: Path, nodes: Sequence[SceneNode], name: str = "", skipped: Sequence[Skipped] = ()
) -> World:
    """Return the world of a scene: an object for each node with a surface, or with a lost one.

    The nearest node above it that is an object, too, holds it. Types are guessed from the names.
    A node of which the file states what it is needs no surface. The joints of what moves become
    properties (`semmap.manipulation.moving_part` describes them).
    `skipped` is what was left out of the nodes.

    Raises
    ------
    WorldError
        No node has a surface, and none was left out; or they have more triangles than the limit.
    """
    world = World(name or path.stem, path, skipped=[*skipped])
    made: dict[SceneNode, Entry] = {}
    taken: set[str] = set()
    faces = 0
    for node in nodes:
        if not (node.meshes or node.lost or node.stated):
            continue
        faces += sum(len(mesh.faces) for mesh in node.meshes)
        TRIANGLES.check(faces, partial(WorldError, path, "scene"), SIMPLER)
        try:
            away = float(np.abs(node.pose.translation).max())
            EXTENT.check(away, MeshFileError, "Correct its unit or pose.", "stands at")
            mesh = None
            if node.meshes:
                mesh = checked(tidy(join(node.meshes).moved(node.pose.inverse())))
        except MeshFileError as error:
            world.skipped.append(Skipped(node.name, error.problem, error.fix))
            continue
        above, joint = node.above, node.joint
        while above is not None and above not in made:
            if above.joint is not None:
                moved = above.joint.seen_from(node.pose.inverse() @ above.pose)
                joint = moved if joint is None else replace(joint, type="several")
            above = above.above
        name = unique_name(node.name, taken)
        entry = replace(node.stated or Entry(name, "object"), name=name, pose=node.pose)
        if entry.kind == "storey":
            entry.detail = StoreyDetail(node.pose.z)
        elif mesh is not None:
            entry.shapes = [Shape("mesh", mesh, uri=f"{path.name}#{node.name}")]
            if entry.kind in ("room", "region"):
                _make_place(entry, mesh)
        if above is not None:
            entry.holder, entry.pose = made[above].name, above.pose.inverse() @ node.pose
        if joint is not None:
            stated = {"joint": asdict(joint) | {"closed": list(entry.pose or node.pose)}}
            entry.properties = entry.properties | stated
            if entry.holder is not None:
                world.links.append(WorldLink(entry.name, JOINTED, entry.holder))
        elif above is not None and "joint" in made[above].properties:
            entry.properties = entry.properties | {"joint": {"type": "fixed"}}
        if node.stated is None:
            give_type(entry, (node.name,))
        taken.add(entry.name)
        made[node] = entry
        world.entries.append(entry)
    if not world.entries and not world.skipped:
        raise WorldError(path, "scene", "no node has a surface", "Export it with its meshes.")
    return world


def _make_place(entry: Entry, floor: Mesh) -> None:
    """Give a room or region the solid above the face that a file has of its floor."""
    low, outline = float(floor.bounds[0, 2]), silhouette(floor)
    if outline.area > 0:
        entry.shapes = [Shape("polygon", prism_mesh(outline, low, low + ROOM_HEIGHT), outline)]
    if entry.kind == "room":
        entry.detail = PlaceDetail(low)


def rigid_pose(matrix: NDArray[np.float64]) -> Pose:
    """Return the pose that is nearest to an affine transform (4, 4), which may scale and mirror."""
    u, _, v = np.linalg.svd(matrix[:3, :3])
    turn = u @ np.diag((1.0, 1.0, float(np.sign(np.linalg.det(u @ v))))) @ v
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = turn, matrix[:3, 3]
    return Pose.from_matrix(found)
