"""A robot's links with their meshes, and where these are in a joint state."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh, join
from semmap.geometry.outline import hull_points
from semmap.ingest.mesh_file import MeshFileError, read_mesh
from semmap.robot.error import RobotError

__all__ = ["Joint", "Robot", "load_robot"]

GROUND = "base_footprint"
"""The link whose frame lies on the ground, where a robot has it (REP 120)."""

SECTIONS = 48
"""Sides of the prism that stands for a cylinder."""

MOVING = ("revolute", "continuous", "prismatic", "planar", "floating")


@dataclass(frozen=True)
class Joint:
    """A joint; `axis` in the frame of its child, `limits` in radians or metres."""

    name: str
    type: str
    parent: str
    child: str
    axis: tuple[float, float, float]
    limits: tuple[float, float]
    mimics: str | None = None

    @property
    def moves(self) -> bool:
        """Whether it is not fixed."""
        return self.type in MOVING


@dataclass(eq=False)
class Robot:
    """A robot as its URDF describes it.

    Attributes
    ----------
    base : the link in whose frame, moved up or down to the ground, all else is given
    joints : parents before their children
    meshes : by link, in the link's frame, metres: what collides, where nothing does what is seen
    """

    name: str
    base: str
    joints: tuple[Joint, ...]
    meshes: dict[str, Mesh]
    _urdf: Any = field(repr=False)
    _hulls: dict[str, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    _ground: float = field(default=0.0, repr=False)

    def __post_init__(self) -> None:
        for link, mesh in self.meshes.items():
            self._hulls[link] = hull_points(mesh)
        if self.base != GROUND and self._hulls:
            lowest = min(points[:, 2].min() for points in self.hulls({}).values())
            self._ground = float(lowest)

    @property
    def links(self) -> tuple[str, ...]:
        """All links, parents before their children."""
        return (self._urdf.base_link, *(joint.child for joint in self.joints))

    def link_poses(self, state: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """The frame of each link with geometry, (4, 4), in the robot's frame on the ground.

        Parameters
        ----------
        state : joint positions, radians or metres; a joint that is not named is at 0, or at the
            end of its limits that is nearest to it

        Raises
        ------
        RobotError
            A joint that the robot has not, that mimics another, or a position beyond its limits.
        """
        self._urdf.update_cfg(self._complete(state))
        poses = {}
        for link in self.meshes:
            pose = np.array(self._urdf.get_transform(link, self.base), dtype=np.float64)
            pose[2, 3] -= self._ground
            poses[link] = pose
        return poses

    def axis(self, joint: Joint) -> NDArray[np.float64]:
        """The axis (3,) of a joint in the robot's frame, with all joints at rest."""
        self._urdf.update_cfg(self._complete({}))
        turned = np.asarray(self._urdf.get_transform(joint.child, self.base))[:3, :3] @ joint.axis
        axis: NDArray[np.float64] = turned / np.linalg.norm(turned)
        return axis

    def hulls(self, state: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """By link the corners (N, 3) of its convex hull in the robot's frame on the ground."""
        return {
            link: self._hulls[link] @ pose[:3, :3].T + pose[:3, 3]
            for link, pose in self.link_poses(state).items()
        }

    def link_meshes(self, state: Mapping[str, float]) -> dict[str, Mesh]:
        """By link its mesh in the robot's frame on the ground."""
        return {
            link: Mesh(
                self.meshes[link].vertices @ pose[:3, :3].T + pose[:3, 3], self.meshes[link].faces
            )
            for link, pose in self.link_poses(state).items()
        }

    def _complete(self, state: Mapping[str, float]) -> dict[str, float]:
        known = {joint.name: joint for joint in self.joints if joint.moves}
        for name, value in state.items():
            joint = known.get(name)
            if joint is None:
                raise RobotError(
                    f"{self.name}: has no joint {name} that moves; it has {', '.join(known)}"
                )
            if joint.mimics is not None:
                raise RobotError(f"{self.name}: joint {name} follows {joint.mimics}: set that one")
            low, high = joint.limits
            if not low - 1e-6 <= value <= high + 1e-6:
                raise RobotError(
                    f"{self.name}: joint {name} goes from {low:g} to {high:g}, not to {value:g}"
                )
        return {
            name: float(state.get(name, min(max(0.0, joint.limits[0]), joint.limits[1])))
            for name, joint in known.items()
            if joint.mimics is None and joint.type not in ("planar", "floating")
        }


def load_robot(path: Path | str) -> Robot:
    """The robot of a URDF.

    ``package://`` URIs are looked for in the folders above the file, in ``share`` there, and in
    ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``.

    Raises
    ------
    RobotError
        A file that is not there or is no URDF, a mesh that is not found or cannot be read.
    """
    import yourdfpy

    path = Path(path)
    if not path.is_file():
        raise RobotError(f"{path}: is not there. Name a URDF (of a xacro: xacro FILE > robot.urdf)")
    logging.getLogger("yourdfpy").setLevel(logging.ERROR)
    try:
        urdf = yourdfpy.URDF.load(
            str(path), load_meshes=False, load_collision_meshes=False,
            filename_handler=lambda name: name,
        )  # fmt: skip
        base = str(urdf.base_link)
    except Exception as error:
        raise RobotError(f"{path}: is no URDF that can be used: {error}") from error
    joints = _ordered([_joint(j) for j in urdf.robot.joints], base)
    meshes = {}
    for link in urdf.robot.links:
        parts = [_shape(item, path, link.name) for item in link.collisions or link.visuals]
        parts = [part for part in parts if len(part.faces)]
        if parts:
            meshes[link.name] = join(parts)
    if not meshes:
        raise RobotError(f"{path}: no link has geometry. Give its links collision geometry")
    names = {base, *(joint.child for joint in joints)}
    return Robot(
        urdf.robot.name or path.stem, GROUND if GROUND in names else base, joints, meshes, urdf
    )


def _joint(said: Any) -> Joint:
    axis = (1.0, 0.0, 0.0) if said.axis is None else tuple(float(v) for v in said.axis)
    limits = (-math.inf, math.inf)
    if said.type in ("revolute", "prismatic") and said.limit is not None:
        limits = (float(said.limit.lower or 0.0), float(said.limit.upper or 0.0))
    mimics = None if said.mimic is None else str(said.mimic.joint)
    x, y, z = axis
    return Joint(said.name, said.type, said.parent, said.child, (x, y, z), limits, mimics)


def _ordered(joints: list[Joint], base: str) -> tuple[Joint, ...]:
    """Parents before their children, in the order of the file."""
    known, ordered, left = {base}, [], joints
    while left:
        ready = [j for j in left if j.parent in known]
        if not ready:
            raise RobotError(f"joints {', '.join(j.name for j in left)} hang on no link")
        ordered += ready
        known |= {j.child for j in ready}
        left = [j for j in left if j.child not in known]
    return tuple(ordered)


def _shape(item: Any, file: Path, link: str) -> Mesh:
    """A link's shape in the link's frame."""
    import trimesh  # slow to load, and most commands need no robot

    geometry = item.geometry
    if geometry.box is not None:
        shape = trimesh.creation.box(extents=geometry.box.size)
    elif geometry.cylinder is not None:
        c = geometry.cylinder
        around = c.radius / math.cos(math.pi / SECTIONS)  # none of the round one is left outside
        shape = trimesh.creation.cylinder(radius=around, height=c.length, sections=SECTIONS)
    elif geometry.sphere is not None:
        shape = trimesh.creation.icosphere(subdivisions=3)
        deepest = float(np.linalg.norm(shape.triangles_center, axis=1).min())
        shape.apply_scale(geometry.sphere.radius / deepest)
    elif geometry.mesh is not None:
        shape = _mesh(geometry.mesh, file, link)
    else:
        return Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32))
    origin = np.eye(4) if item.origin is None else np.asarray(item.origin, dtype=np.float64)
    vertices = np.asarray(shape.vertices, np.float64) @ origin[:3, :3].T + origin[:3, 3]
    return Mesh(vertices, np.asarray(shape.faces, np.int32))


def _mesh(said: Any, file: Path, link: str) -> Mesh:
    found = _find(str(said.filename), file)
    if found is None:
        raise RobotError(
            f"{file}: link {link}: its mesh {said.filename} is not found. Put its package beside "
            "the file or above it, or name the packages' folder in ROS_PACKAGE_PATH"
        )
    try:
        # RViz and Gazebo scale by COLLADA's unit, and do not turn by its up axis.
        shape = read_mesh(found, dae_up_axis=False)
    except MeshFileError as error:
        raise RobotError(f"{file}: link {link}: {found.name}: {error}") from error
    if said.scale is not None:
        return Mesh(shape.vertices * np.asarray(said.scale, dtype=float), shape.faces)
    return shape


def _find(uri: str, file: Path) -> Path | None:
    """The file that a mesh's URI names."""
    scheme, _, rest = uri.rpartition("://")
    if scheme in ("", "file"):
        place = Path(rest)
        return next((p for p in (place, file.parent / place) if p.is_file()), None)
    folders = [above for parent in file.resolve().parents for above in (parent, parent / "share")]
    for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        folders += [Path(p) / below for p in os.environ.get(variable, "").split(":") if p]
    name = Path(rest)
    candidates = [folder / name for folder in folders]
    # A checkout of a package may have another name than the package.
    candidates += [parent / Path(*name.parts[1:]) for parent in file.resolve().parents]
    return next((c for c in candidates if c.is_file()), None)
