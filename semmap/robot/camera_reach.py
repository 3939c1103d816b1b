"""Where a robot can hold the camera of its head: how high, how steep, how far to the side."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from semmap.arrays import Floats
from semmap.robot.urdf import Joint, Robot

CAMERA = re.compile(r"camera|rgb|kinect|xtion|realsense|stereo|optical", re.IGNORECASE)
"""In the names of links with cameras: URDF says nothing of sensors."""

OPTICAL = re.compile(r"optical", re.IGNORECASE)
"""In the names of frames whose z axis looks ahead (REP 103); that of others is x."""

STEEP = 1.1  # radians downwards beyond which a camera shows the robot itself
UPWARDS = 0.3  # radians above the horizon that a search needs at most
STEP = 0.5  # radians between two tilts that are told apart
LEAST = 0.05  # metres of lift that are worth a second height


class CameraReach(NamedTuple):
    """How a robot can hold a camera.

    The `heights` are metres above the ground, the `pitches` downwards from the horizon, and `pan`
    is how far it turns to both sides, radians.
    """

    link: str
    heights: tuple[float, ...]
    pitches: tuple[float, ...]
    pan: float


def camera_reach(robot: Robot) -> CameraReach | None:
    """How a robot can hold the camera of its head; None if it has none that looks ahead.

    Between the base and the camera are at most one lift, one joint that pans and one that tilts:
    the camera of a hand moves with its arm. Of several, the one that turns most counts, then the
    highest.
    """
    above = {joint.child: joint for joint in robot.joints}
    found = []
    for link in robot.links:
        if CAMERA.search(link):
            joints = _moving(link, above)
            kinds = {_kind(robot, joint): joint for joint in joints}
            if len(kinds) == len(joints) and "other" not in kinds:
                height, pitch = _held(robot, link, {})
                if abs(pitch) <= STEEP and _looks_ahead(robot, link):
                    turns = len(kinds.keys() & {"pan", "tilt"})
                    found.append((turns, height, bool(OPTICAL.search(link)), link, kinds))
    if not found:
        return None
    *_, link, kinds = max(found, key=lambda camera: camera[:3])
    return CameraReach(link, *_range(robot, link, kinds))


def _moving(link: str, above: Mapping[str, Joint]) -> list[Joint]:
    """The joints that move a link, from it to the base."""
    joints = []
    while (joint := above.get(link)) is not None:
        if joint.moves:
            joints.append(joint)
        link = joint.parent
    return joints


def _kind(robot: Robot, joint: Joint) -> str:
    upright = abs(robot.axis(joint)[2])
    if joint.mimics is None and joint.type in ("revolute", "continuous", "prismatic"):
        if upright > 0.9:
            return "lift" if joint.type == "prismatic" else "pan"
        if upright < 0.1 and joint.type == "revolute":
            return "tilt"
    return "other"


def _ahead(pose: Floats, link: str) -> Floats:
    return np.asarray(pose[:3, 2] if OPTICAL.search(link) else pose[:3, 0])


def _held(robot: Robot, link: str, state: Mapping[str, float]) -> tuple[float, float]:
    """The height of a camera, and its pitch downwards, in a joint state."""
    pose = robot.link_poses(state, [link])[link]
    return float(pose[2, 3]), -math.asin(np.clip(_ahead(pose, link)[2], -1, 1))


def _looks_ahead(robot: Robot, link: str) -> bool:
    return bool(_ahead(robot.link_poses({}, [link])[link], link)[0] > 0.3)


def _range(
    robot: Robot, link: str, kinds: Mapping[str, Joint]
) -> tuple[tuple[float, ...], tuple[float, ...], float]:
    """The heights, the pitches and the pan that joints of these kinds reach."""
    heights = [_held(robot, link, {})[0]]
    if "lift" in kinds and np.isfinite(kinds["lift"].limits).all():
        lift = kinds["lift"]
        ends = [_held(robot, link, {lift.name: limit})[0] for limit in lift.limits]
        heights = [*np.linspace(min(ends), max(ends), 3 if np.ptp(ends) > LEAST else 1)]
    pitches = [_held(robot, link, {})[1]]
    if "tilt" in kinds and np.isfinite(kinds["tilt"].limits).all():
        tilt = kinds["tilt"]
        held = [_held(robot, link, {tilt.name: a})[1] for a in np.linspace(*tilt.limits, 50)]
        low, high = max(min(held), -UPWARDS), min(max(held), STEEP)
        if low < high:
            pitches = [*np.linspace(low, high, math.ceil((high - low) / STEP) + 1)]
    pan = 0.0
    if "pan" in kinds:
        joint = kinds["pan"]
        pan = math.pi if joint.type == "continuous" else min(map(abs, joint.limits))
    return tuple(map(float, heights)), tuple(map(float, pitches)), min(pan, math.pi)
