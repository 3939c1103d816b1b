"""What a gripper is: its postures from open to closed, and its grasp frame.

The grasp frame has its origin between the pads of the open fingers, +z is the approach and +x the
direction in which the fingers close. That of a suction cup is in the middle of its lip.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull

from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh
from semmap.manipulation.link_tree import LinkTree
from semmap.manipulation.suction import Cup
from semmap.robot.urdf import Robot

PAD = 0.02
"""The length of a finger's end that touches the object, metres."""

BESIDE = 0.004
"""Metres by which the moving jaw brings an object to the other one, which first is beside it."""

TILT = 5e-3
"""The largest difference from the tilt of a gripper that its arm cannot tilt, radians."""


@dataclass(frozen=True, eq=False)
class Gripper:
    """A gripper with its postures from open to closed.

    `palm` is the link that holds the fingers, `frame` (4, 4) the grasp frame in its frame;
    `fingers` are the links of each finger that touches objects, `postures` the S positions of their
    joints, radians or metres. `widths` (S,) are metres between the pads, falling, and `reaches`
    (S,) z of their middle in the grasp frame: fingers that turn reach further as they close.
    Objects thicker than `depth`, metres from palm to pads, touch the palm. `spread` (P,) are
    offsets along y of the fingers on the side of +x, a single 0 where two oppose each other. A
    symmetric one may turn by half about the approach. `poses` (S, L, 4, 4) are those of all
    `links`, the rigid ones first, in the grasp frame; `hulls` are their corners (N, 3) in the
    frames of the links. A link that is a jaw is there once for each of its slices. `up` (3,) is the
    vertical in the grasp frame where no joint of the arm tilts the gripper, else None. Where only
    one jaw moves, the middle between the pads moves along x by `aside` (S,) metres.

    A suction cup has one posture without joints; `palm` is its link, its width the diameter of the
    lip, and its depth the length of the link. `stiff` are its hulls without what is soft, which
    gives way to the object.
    """

    name: str
    kind: Literal["parallel", "multi-finger", "suction"]
    palm: str
    frame: Floats
    fingers: tuple[tuple[str, ...], ...]
    postures: tuple[dict[str, float], ...]
    widths: Floats
    reaches: Floats
    depth: float
    spread: Floats
    is_symmetric: bool
    links: tuple[str, ...]
    poses: Floats = field(repr=False)
    robot: Robot = field(repr=False)
    hulls: tuple[Floats, ...] = field(repr=False)
    aside: Floats = field(repr=False)
    up: Floats | None = None
    is_assumed: bool = False  # the URDF has no limits of the finger joints: `SWING`, `SLIDE`
    cup: Cup | None = None
    stiff: tuple[Floats, ...] | None = field(default=None, repr=False)

    def can_tilt_to(self, pose: Floats) -> bool:
        """Whether the arm may tilt the gripper as in a pose (4, 4), of a robot on level ground."""
        return self.up is None or bool(np.abs(pose[2, :3] - self.up).max() < TILT)

    @property
    def opening(self) -> float:
        """Metres between the pads of the open gripper, or across the lip of a suction cup."""
        return float(self.widths[0])

    def pads_at(self, widths: Floats) -> Floats:
        """(N, 3) where the middle of an object of widths (N,) is in the grasp frame, to be held.

        One jaw that moves brings it up to `BESIDE` further, to the other one.
        """
        aside = np.sign(self.aside) * np.maximum(np.abs(self.aside) - BESIDE, 0)
        found = np.zeros((len(widths), 3))
        for axis, series in ((0, aside), (2, self.reaches)):
            found[:, axis] = np.interp(-widths, -self.widths, series)
        return found

    @property
    def stiff_hulls(self) -> tuple[Floats, ...]:
        """As `hulls`, the corners of those parts of links that the object must not touch."""
        return self.hulls if self.stiff is None else self.stiff

    @property
    def swept_volume(self) -> float:
        """The volume that the fingers pass while they close, m³: hulls of open, half and closed."""
        volume, rigid = 0.0, self.rigid
        for finger in self.fingers:
            points = [
                transformed(hull, pose)
                for poses in self.poses[[0, len(self.poses) // 2, -1]]
                for link, pose, hull in zip(self.links, poses, self.hulls, strict=True)
                if link in finger and link not in rigid
            ]
            if points:
                volume += ConvexHull(np.concatenate(points), qhull_options="QJ").volume
        return volume

    @property
    def rigid(self) -> frozenset[str]:
        """The palm and all links that are fixed to it."""
        return frozenset(LinkTree(self.robot).rigid(self.palm))

    @property
    def margins(self) -> frozenset[str]:
        """Links that keep a distance around the hand and are not a part of the gripper."""
        return self.rigid - frozenset(self.links)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that move the fingers; joints that mimic others are left out."""
        return tuple(self.postures[0])

    def posture(self, width: float) -> dict[str, float]:
        """The positions of the finger joints at a width between the pads."""
        at, last = self._at(width), len(self.postures) - 1
        low = min(int(at), max(last - 1, 0))
        a, b = self.postures[low], self.postures[min(low + 1, last)]
        return {name: a[name] + (at - low) * (b[name] - a[name]) for name in a}

    def index(self, width: float) -> int:
        """The number of the narrowest posture that is at least this wide."""
        return int(np.floor(self._at(width) + 1e-9))

    def meshes(self, width: float) -> dict[str, Mesh]:
        """The meshes of the links in the grasp frame, near a width between the pads."""
        return {
            link: _placed(self.robot.meshes[link], pose)
            for link, pose in zip(self.links, self.poses[self.index(width)], strict=True)
            if link in self.robot.meshes
        }

    def _at(self, width: float) -> float:
        return float(np.interp(-width, -self.widths, np.arange(len(self.widths))))


def _placed(mesh: Mesh, pose: Floats) -> Mesh:
    return Mesh(transformed(mesh.vertices, pose), mesh.faces)


def transformed(points: Floats, pose: Floats) -> Floats:
    """Points (N, 3) of the frame at a pose (4, 4), in the outer frame."""
    moved: Floats = points @ pose[:3, :3].T + pose[:3, 3]
    return moved
