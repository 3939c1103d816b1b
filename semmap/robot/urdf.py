"""A robot's links with their meshes, and their poses in a joint state."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh, join
from semmap.geometry.outline import hull_points
from semmap.ingest.meshes.mesh_size import MeshFileError
from semmap.ingest.sdf.resources import package_folders
from semmap.limits import EXTENT, LINKS, PARTS, TEXT_BYTES, TRIANGLES
from semmap.robot.error import RobotError

GROUND = "base_footprint"
"""The name of the link whose frame lies on the ground, if a robot has it (REP 120)."""

SECTIONS = 48
"""Sides of the prism that approximates a cylinder."""

VACUUM_PLUGIN = "vacuum_gripper"
"""What the file name of Gazebo's plugin for vacuum grippers has in it."""

MOVING = ("revolute", "continuous", "prismatic", "planar", "floating")


@dataclass(frozen=True)
class Joint:
    """A joint; `axis` in the frame of its child, `limits` in radians or metres.

    `velocity` is its limit in those a second, infinite where the URDF states none above 0.
    """

    name: str
    type: str
    parent: str
    child: str
    axis: tuple[float, float, float]
    limits: tuple[float, float]
    mimics: str | None = None
    velocity: float = math.inf

    @property
    def moves(self) -> bool:
        """Whether it is not fixed."""
        return self.type in MOVING


@dataclass(eq=False)
class Robot:
    """A robot as its URDF describes it.

    The frame of `base`, moved up or down to the ground, is the robot's frame; `joints` have parents
    before their children; `meshes`, metres in the link's frame, are collision geometry, else
    visual. `vacuum_links` are those that Gazebo's plugin for vacuum grippers names.
    """

    name: str
    base: str
    joints: tuple[Joint, ...]
    meshes: dict[str, Mesh]
    _urdf: Any = field(repr=False)
    _hulls: dict[str, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    _ground: float = field(default=0.0, repr=False)
    vacuum_links: frozenset[str] = frozenset()

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

    def link_poses(
        self, state: Mapping[str, float], links: Iterable[str] | None = None
    ) -> dict[str, NDArray[np.float64]]:
        """Return the pose (4, 4) of links, by default those with geometry, in the robot's frame.

        The frame is on the ground. Other joints than those of `state`, radians or metres, are at 0,
        or at the limit that is nearest to 0.

        Raises
        ------
        RobotError
            The robot has no such joint, it mimics another, or a position is beyond its limits.
        """
        self._urdf.update_cfg(self._complete(state))
        poses = {}
        for link in self.meshes if links is None else links:
            pose = np.array(self._urdf.get_transform(link, self.base), dtype=np.float64)
            pose[2, 3] -= self._ground
            poses[link] = pose
        return poses

    def transform(self, joint: Joint, state: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the pose (4, 4) of a joint's child in the frame of its parent.

        Joints that `state` does not name are at 0; a joint that mimics another follows it.
        """
        from scipy.spatial.transform import Rotation  # slow to load

        read = self._urdf.joint_map[joint.name]
        pose = np.eye(4) if read.origin is None else np.array(read.origin, np.float64)
        multiplier, offset = self.mimicry(joint)
        position = multiplier * float(state.get(joint.mimics or joint.name, 0.0)) + offset
        axis = np.array(joint.axis) / max(float(np.linalg.norm(joint.axis)), 1e-12)
        if joint.type in ("revolute", "continuous"):
            pose[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(position * axis).as_matrix()
        elif joint.type == "prismatic":
            pose[:3, 3] += pose[:3, :3] @ axis * position
        return pose

    def mimicry(self, joint: Joint) -> tuple[float, float]:
        """Return (multiplier, offset) with which a joint follows the one that it mimics."""
        mimic = self._urdf.joint_map[joint.name].mimic
        given = (None, None) if mimic is None else (mimic.multiplier, mimic.offset)
        return 1.0 if given[0] is None else float(given[0]), float(given[1] or 0.0)

    def axis(self, joint: Joint) -> NDArray[np.float64]:
        """Return the axis (3,) of a joint in the robot's frame, with all joints at rest."""
        self._urdf.update_cfg(self._complete({}))
        turned = np.asarray(self._urdf.get_transform(joint.child, self.base))[:3, :3] @ joint.axis
        axis: NDArray[np.float64] = turned / np.linalg.norm(turned)
        return axis

    def is_seen(self, link: str) -> bool:
        """Return whether a link has visual geometry, not collision geometry alone."""
        return bool(self._urdf.link_map[link].visuals)

    def hull(self, link: str) -> NDArray[np.float64]:
        """Return the corners (N, 3) of the hull of a link in its own frame."""
        return self._hulls[link]

    def hulls(self, state: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
        """Return the hull's corners (N, 3) of each link, in the robot's frame on the ground."""
        return {
            link: self._hulls[link] @ pose[:3, :3].T + pose[:3, 3]
            for link, pose in self.link_poses(state).items()
        }

    def link_meshes(self, state: Mapping[str, float]) -> dict[str, Mesh]:
        """Return each link's mesh in the robot's frame on the ground."""
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
                    f"{self.name}: has no movable joint {name}; it has {', '.join(known)}"
                )
            if joint.mimics is not None:
                raise RobotError(f"{self.name}: joint {name} follows {joint.mimics}: set that one")
            low, high = joint.limits
            if not (math.isfinite(value) and low - 1e-6 <= value <= high + 1e-6):
                raise RobotError(
                    f"{self.name}: joint {name} goes from {low:g} to {high:g}, not to {value:g}"
                )
            if joint.type == "prismatic" and EXTENT.exceeded_by(abs(value)):
                raise RobotError(
                    f"{self.name}: joint {name} is moved by {value:g} m: give at most "
                    f"{EXTENT.value:g}, or set {EXTENT.variable}"
                )
        return {
            name: float(state.get(name, min(max(0.0, joint.limits[0]), joint.limits[1])))
            for name, joint in known.items()
            if joint.mimics is None and joint.type not in ("planar", "floating")
        }


def load_robot(path: Path | str) -> Robot:
    """Return the robot of a URDF.

    ``package://`` URIs are searched in the folders above the file, in ``share`` there, and in
    ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``.

    Raises
    ------
    RobotError
        The file is missing or not a URDF, or a mesh is not found or cannot be read.
    """
    import yourdfpy

    path = Path(path)
    if not path.is_file():
        raise RobotError(
            f"{path}: does not exist. Name a URDF (of a xacro: xacro FILE > robot.urdf)"
        )
    _check_file(path)
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)
    lean: dict[str, Any] = {"load_meshes": False, "filename_handler": lambda name: name}
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are refused below
            read = yourdfpy.URDF.load(str(path), build_scene_graph=False, **lean).robot
        joints = [_joint(joint, path) for joint in read.joints]
        urdf = yourdfpy.URDF(read, **lean)
        base = str(urdf.base_link)
        ordered = _ordered(joints, base)
    except RobotError:
        raise
    except Exception as error:
        raise RobotError(f"{path}: is not a usable URDF: {error}") from error
    shapes = [(k.name, item) for k in read.links for item in k.collisions or k.visuals]
    PARTS.check(len(shapes), _error(path, "robot"), "Join its shapes.")
    parts: dict[str, list[Mesh]] = {}
    faces = 0
    for link, item in shapes:
        part = _shape(item, path, link)
        faces += len(part.faces)
        TRIANGLES.check(faces, _error(path, f"link {link}"), "Give simpler collision geometry.")
        if len(part.faces):
            parts.setdefault(link, []).append(part)
    if not parts:
        raise RobotError(f"{path}: no link has geometry. Give its links collision geometry")
    meshes = {link: join(each) for link, each in parts.items()}
    names = {base, *(joint.child for joint in ordered)}
    for link in sorted(meshes.keys() - names):
        raise _error(path, f"link {link}")(f"no joint joins it to {base}", "Add one.")
    root = GROUND if GROUND in names else base
    told = _vacuum_links(path) & names
    return Robot(read.name or path.stem, root, ordered, meshes, urdf, vacuum_links=told)


def _error(path: Path, element: str) -> Callable[[str, str], RobotError]:
    """Return a function that makes an error of a problem and a fix."""
    return lambda problem, fix: RobotError(f"{path}: {element}: {problem}. {fix}")


def _vacuum_links(path: Path) -> frozenset[str]:
    """The links that elements of Gazebo's plugin name: ``bodyName``, or ``link_name`` in ROS 2."""
    from lxml import etree

    # as yourdfpy reads it, also where the encoding is another one or a prefix has no namespace
    parser = etree.XMLParser(recover=True, resolve_entities=False)
    root = etree.fromstring(path.read_bytes(), parser)
    found = set()
    for plugin in root.iter("plugin"):
        if VACUUM_PLUGIN in plugin.get("filename", ""):
            for each in plugin.iter("bodyName", "link_name"):
                found.add((each.text or "").strip().split("::")[-1])
    return frozenset(found)


def _check_file(path: Path) -> None:
    """Refuse files that would take minutes to parse."""
    error = _error(path, "file")
    TEXT_BYTES.check(path.stat().st_size, error, "Is it a URDF?")
    try:
        text = path.read_text("utf-8")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:  # UTF-16 without a byte order mark has these
        raise error("is not UTF-8", "Save it as UTF-8.")
    if "<!DOCTYPE" in text:
        raise error("declares a document type", "Remove the <!DOCTYPE ...> declaration.")
    LINKS.check(text.count("<link"), error, "Leave out links without effect.")


def _numbers(
    value: Any, count: int, where: Callable[[str, str], RobotError], what: str
) -> NDArray[np.float64]:
    """Return the (count,) numbers of an attribute, finite and within the extent of a map."""
    found = np.asarray(value, dtype=np.float64).reshape(-1)
    if len(found) != count or not np.isfinite(found).all():
        numbers = "a finite number" if count == 1 else f"{count} finite numbers"
        raise where(f"its {what} is {value}", f"Give {numbers}.")
    EXTENT.check(float(np.abs(found).max()), where, "Correct it.", f"its {what} reaches")
    return found


def _sizes(
    value: Any, count: int, where: Callable[[str, str], RobotError], what: str
) -> NDArray[np.float64]:
    sizes = _numbers(value, count, where, what)
    if (sizes < 0).any():
        raise where(f"its {what} is {value}", "Give sizes of at least 0 m.")
    return sizes


def _origin(value: Any, where: Callable[[str, str], RobotError]) -> NDArray[np.float64]:
    """Return a finite pose (4, 4)."""
    if value is None:
        return np.eye(4)
    pose: NDArray[np.float64] = np.asarray(value, dtype=np.float64)
    _numbers(pose[:3, 3], 3, where, "origin xyz")
    _numbers(pose[:3, :3], 9, where, "origin rpy")
    return pose


def _joint(read: Any, path: Path) -> Joint:
    error = _error(path, f"joint {read.name}")
    _origin(read.origin, error)
    axis = np.array((1.0, 0.0, 0.0)) if read.axis is None else _numbers(read.axis, 3, error, "axis")
    length = float(np.linalg.norm(axis))
    if read.type in MOVING and length < 1e-6:
        raise error("its axis has no length", 'Give a direction: <axis xyz="0 0 1"/>.')
    limits = (-math.inf, math.inf)
    if read.type in ("revolute", "prismatic") and read.limit is not None:
        limits = (float(read.limit.lower or 0.0), float(read.limit.upper or 0.0))
        if not limits[0] <= limits[1]:
            raise error(f"its limits are {limits[0]:g} and {limits[1]:g}", "Give lower <= upper.")
        _numbers(min(max(0.0, limits[0]), limits[1]), 1, error, "position at rest")
    mimics = None
    if read.mimic is not None:
        mimics = str(read.mimic.joint)
        _numbers((read.mimic.multiplier, read.mimic.offset), 2, error, "mimic")
    stated = 0.0 if read.limit is None else float(read.limit.velocity or 0.0)
    velocity = stated if stated > 0 else math.inf
    x, y, z = axis.tolist()
    return Joint(read.name, read.type, read.parent, read.child, (x, y, z), limits, mimics, velocity)


def _ordered(joints: list[Joint], base: str) -> tuple[Joint, ...]:
    """Return the joints, parents before their children, in the order of the file."""
    known, ordered, left = {base}, [], joints
    while left:
        ready = [j for j in left if j.parent in known]
        if not ready:
            raise RobotError(
                f"joints {', '.join(j.name for j in left)} are not connected to the base"
            )
        ordered += ready
        known |= {j.child for j in ready}
        left = [j for j in left if j.child not in known]
    return tuple(ordered)


def _shape(item: Any, file: Path, link: str) -> Mesh:
    """Return a link's shape in the link's frame."""
    import trimesh  # slow to load, and most commands need no robot

    error = _error(file, f"link {link}")
    origin = _origin(item.origin, error)
    geometry = item.geometry
    if geometry is None:
        return Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32))
    if geometry.box is not None:
        size = _sizes(geometry.box.size, 3, error, "box size")
        shape = trimesh.creation.box(extents=size)
    elif geometry.cylinder is not None:
        c = geometry.cylinder
        radius, height = _sizes((c.radius, c.length), 2, error, "cylinder radius and length")
        around = radius / math.cos(math.pi / SECTIONS)  # contains the round cylinder
        shape = trimesh.creation.cylinder(radius=around, height=height, sections=SECTIONS)
    elif geometry.sphere is not None:
        (radius,) = _sizes(geometry.sphere.radius, 1, error, "sphere radius")
        shape = trimesh.creation.icosphere(subdivisions=3)
        deepest = float(np.linalg.norm(shape.triangles_center, axis=1).min())
        shape = Mesh(np.asarray(shape.vertices) * (radius / deepest), np.asarray(shape.faces))
    elif geometry.mesh is not None:
        shape = _mesh(geometry.mesh, file, error)
    else:
        return Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32))
    vertices = np.asarray(shape.vertices, np.float64) @ origin[:3, :3].T + origin[:3, 3]
    return Mesh(vertices, np.asarray(shape.faces, np.int32))


def _mesh(read: Any, file: Path, error: Callable[[str, str], RobotError]) -> Mesh:
    from semmap.ingest.meshes.mesh_file import read_mesh  # slow to load

    found = _find(str(read.filename), file)
    if found is None:
        raise error(
            f"its mesh {read.filename} is not found",
            "Put its package beside the file or above it, or name the packages' folder in "
            "ROS_PACKAGE_PATH",
        )
    try:
        # RViz and Gazebo scale by COLLADA's unit, and do not turn by its up axis.
        shape = read_mesh(found, dae_up_axis=False)
    except MeshFileError as problem:
        raise error(f"{found.name}: {problem.problem}", problem.fix) from problem
    if read.scale is None:
        return shape
    scale = np.ravel(read.scale)
    factors = _numbers(scale, 1 if len(scale) == 1 else 3, error, "mesh scale")
    mesh = Mesh(shape.vertices * factors, shape.faces)
    _numbers(np.abs(mesh.vertices).max(), 1, error, "scaled mesh")
    return mesh


def _find(uri: str, file: Path) -> Path | None:
    """Return the file that a mesh's URI names."""
    scheme, _, rest = uri.rpartition("://")
    if scheme in ("", "file"):
        place = Path(rest)
        return _first_file([place, file.parent / place])
    folders = [above for parent in file.resolve().parents for above in (parent, parent / "share")]
    folders += package_folders()
    name = Path(rest)
    candidates = [folder / name for folder in folders]
    # A checkout of a package may have another name than the package.
    candidates += [parent / Path(*name.parts[1:]) for parent in file.resolve().parents]
    return _first_file(candidates)


def _first_file(candidates: Iterable[Path]) -> Path | None:
    # `Path.is_file` raises an error where a name is too long.
    return next((c for c in candidates if os.path.isfile(c)), None)  # noqa: PTH113
