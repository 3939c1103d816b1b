"""Suction cups of robots, as URDFs have them: a link that is named so, or that Gazebo knows as one.

No element of a URDF describes a suction cup. Real files name a link so (``suction_cup``,
``epick_suction_cup``, ``vacuum_gripper``), or tell Gazebo's plugin for vacuum grippers which it is.
The far end of its mesh is the lip; a link without a mesh is the frame of a tool, whose +z leads on.
"""

from __future__ import annotations

import re

import numpy as np

from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh
from semmap.geometry.outline import hull_points
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import Gripper, transformed
from semmap.manipulation.link_tree import LinkTree, fixed_vertical
from semmap.manipulation.suction import Cup
from semmap.robot.urdf import Robot

NAMES = re.compile(r"suction|vacuum", re.IGNORECASE)
"""What the names of links that are suction cups have in them."""

RIM = 1e-3
"""Metres of the end of a mesh that are the lip."""

WIDEST = 0.2
"""Metres across a lip beyond which what is named so is the body of a gripper."""


def cup_links(robot: Robot) -> list[str]:
    """The links that are suction cups, in the order of the robot; by Gazebo's plugin, else names.

    Of several in a row, the last one with a mesh: the others hold it.
    """
    told = [k for k in robot.links if k in robot.vacuum_links]
    named = told or [k for k in robot.links if NAMES.search(k)]
    above = {joint.child: joint.parent for joint in robot.joints}
    cups = [link for link in named if link in robot.meshes] or named
    holders = set()
    for link in cups:
        while link in above:
            link = above[link]
            holders.add(link)
    return [link for link in cups if link not in holders]


def read_cup(robot: Robot, link: str, stated: Cup | None = None) -> Gripper:
    """The suction cup that a link is; `stated`, else with the radius of its lip.

    ManipulationError where nothing tells the radius.
    """
    tree = LinkTree(robot)
    poses = tree.poses(tree.rigid(link)[0], {})
    inverse = np.linalg.inv(poses[link])
    group = [k for k in tree.rigid(link) if k in robot.meshes]
    placed = {k: inverse @ poses[k] for k in group}  # in the frame of the cup's link
    reach = _reach(robot, link)
    frame = np.eye(4)
    side = np.eye(3)[(int(np.argmax(np.abs(reach))) + 1) % 3]
    frame[:3, :3] = np.column_stack([side, np.cross(reach, side), reach])
    depth, radius = 0.0, None
    if link in robot.meshes:
        frame[:3, 3], radius = _lip(robot.meshes[link], reach)
        depth = float(np.ptp(robot.meshes[link].used @ reach))
    cup = stated
    if cup is None and radius is not None and radius <= WIDEST / 2:
        cup = Cup.of(radius)
    if cup is None:
        why = "has no mesh" if radius is None else f"ends {2 * radius:.2g} m wide"
        raise ManipulationError(
            f"{link}: {why}, so nothing tells the radius of its suction cup: state it with "
            "suction=RADIUS, in metres"
        )
    to_grasp = np.linalg.inv(frame)
    at = {k: to_grasp @ placed[k] for k in group}
    return Gripper(
        name=robot.name,
        kind="suction",
        palm=link,
        frame=frame,
        fingers=(),
        postures=({},),
        widths=np.array([2 * cup.radius]),
        reaches=np.zeros(1),
        depth=depth,
        spread=np.zeros(1),
        is_symmetric=False,
        links=tuple(group),
        poses=np.array([at[k] for k in group]).reshape(1, -1, 4, 4),
        robot=robot,
        hulls=tuple(robot.hull(k) for k in group),
        aside=np.zeros(1),
        up=fixed_vertical(robot, link, frame),
        cup=cup,
        stiff=tuple(_stiff_part(robot.meshes[k], at[k], cup.soft) for k in group),
    )


def _reach(robot: Robot, link: str) -> Floats:
    """The axis (3,) of a link along which its cup leads on from what holds it."""
    way = np.array([0.0, 0.0, 1.0])
    if link in robot.meshes:
        corners = robot.hull(link)
        way = (corners.min(axis=0) + corners.max(axis=0)) / 2
        joint = next((each for each in robot.joints if each.child == link), None)
        if joint is not None:
            way = way - np.linalg.inv(robot.transform(joint, {}))[:3, 3]
    if np.abs(way).max() < RIM:
        way = np.array([0.0, 0.0, 1.0])
    axis = int(np.argmax(np.abs(way)))
    return np.asarray(np.eye(3)[axis] * np.sign(way[axis]))


def _lip(mesh: Mesh, reach: Floats) -> tuple[Floats, float]:
    """The middle (3,) of the end of a mesh, and how far the end is from it, metres."""
    along = mesh.used @ reach
    end = mesh.used[along > along.max() - RIM]
    middle = (end.min(axis=0) + end.max(axis=0)) / 2
    across = end - middle - np.outer((end - middle) @ reach, reach)
    return middle + (along.max() - middle @ reach) * reach, float(
        np.linalg.norm(across, axis=1).max()
    )


def _stiff_part(mesh: Mesh, pose: Floats, soft: float) -> Floats:
    """Corners (N, 3) of the hull of a link without what is soft, in its frame.

    A link at `pose` (4, 4) in the grasp frame that ends with the lip, or before it, is cut `soft`
    metres behind the lip, but where it begins it is stiff, as is one that leads beyond the lip.
    """
    import trimesh  # slow to load

    corners = hull_points(mesh)
    ahead = transformed(corners, pose)[:, 2]
    cut = max(-soft, ahead.min() + RIM)
    if ahead.max() <= cut or ahead.max() > RIM:
        return corners
    whole = trimesh.Trimesh(transformed(mesh.vertices, pose), mesh.faces)
    part = whole.slice_plane((0, 0, cut), (0, 0, -1))
    stiff = hull_points(Mesh(np.asarray(part.vertices), np.asarray(part.faces, np.int32)))
    return transformed(stiff, np.linalg.inv(pose).astype(np.float64))
