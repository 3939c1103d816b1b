"""The parts of a robot (base, pole, arm; Deeken et al., section 4.3): from YAML, or found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from semmap.robot.error import RobotError
from semmap.robot.urdf import Joint, Robot
from semmap.suggestions import suggestion
from semmap.yaml_file import parse_yaml, read_text

ABOVE_BASE = 0.08
"""Height above the base's largest link up to which links fixed to it are part of it, metres."""

UPRIGHT = 0.95
"""Least cosine of an upright axis."""


@dataclass(frozen=True)
class LinkGroup:
    """A part's name and links."""

    name: str
    links: tuple[str, ...]


def read_groups(path: Path | str, robot: Robot) -> list[LinkGroup]:
    """Return the parts that a YAML file names; links that it does not name form a part ``rest``.

    Each part is a list of links, with wildcards ``*`` and ``?``::

        base: [base_link, "wheel_*"]
        arm: ["arm_*", "gripper*"]

    Raises
    ------
    RobotError
        The file is missing or malformed, or names a link that the robot does not have.
    """
    written = read_text(path, "a file of parts", RobotError)
    given = parse_yaml(written, f"{path}: cannot be read", RobotError)
    if not isinstance(given, dict) or not given:
        raise RobotError(f"{path}: give parts as name: [link, ...]")
    groups, taken = [], set[str]()
    for name, value in given.items():
        if not isinstance(value, list) or not all(isinstance(link, str) for link in value):
            raise RobotError(f"{path}: part {name}: give [link, ...]")
        found: list[str] = []
        for pattern in value:
            matched = [link for link in robot.links if fnmatchcase(link, pattern)]
            if not matched:
                near = suggestion(pattern, robot.links, f"it has {', '.join(robot.links)}")
                raise RobotError(f"{path}: part {name}: {robot.name} has no link {pattern}{near}")
            found += [link for link in matched if link not in taken]
            taken.update(matched)
        groups.append(LinkGroup(str(name), tuple(found)))
    rest = tuple(link for link in robot.links if link not in taken and link in robot.meshes)
    return [*groups, LinkGroup("rest", rest)] if rest else groups


def find_groups(robot: Robot) -> list[LinkGroup]:
    """Return base, torso and limbs, found along the kinematic tree.

    The base is the links on the root that do not rise above its largest link. The torso is the
    links that rise from it without turning: masts, columns, lifts. Links that turn on base or
    torso are a limb, unless a single joint moves them (a tilting laser): a head if the name of a
    link contains ``head``, else an arm.
    """
    hulls = robot.hulls({})
    if not hulls:
        raise RobotError(f"{robot.name}: no link has geometry. Give its links collision geometry")
    tops = {link: float(points[:, 2].max()) for link, points in hulls.items()}
    limit = _base_top(robot, hulls) + ABOVE_BASE
    root = robot.links[0]
    of = {root: "base"}
    roots: dict[str, Joint] = {}
    for joint in robot.joints:
        part, child = of[joint.parent], joint.child
        lifts = not joint.moves or (joint.type == "prismatic" and _is_upright(robot, joint))
        if (
            part == "base"
            and tops.get(child, -np.inf) <= limit
            and not _carries(robot, child, tops, limit, joint)
        ):
            of[child] = "base"
        elif part in ("base", "torso") and lifts:
            of[child] = "torso" if child in tops or part == "torso" or joint.moves else "base"
        elif part in ("base", "torso"):
            of[child] = child  # a limb, by its first link
            roots[child] = joint
        else:
            of[child] = part
    parents = {child: joint.parent for child, joint in roots.items()}
    for limb in roots:
        members = {link for link, part in of.items() if part == limb}
        moved = [j for j in robot.joints if j.child in members and j.moves and j.mimics is None]
        if len(moved) < 2 and not any("head" in link for link in members):
            for link in members:
                of[link] = of[parents[limb]]
    names = _limb_names([limb for limb in roots if limb in of.values()], of)
    groups: dict[str, list[str]] = {"base": [], "torso": []}
    for link in robot.links:
        groups.setdefault(names.get(of[link], of[link]), []).append(link)
    return [
        LinkGroup(name, tuple(links))
        for name, links in groups.items()
        if any(link in robot.meshes for link in links)
    ]


def _is_upright(robot: Robot, joint: Joint) -> bool:
    return bool(abs(robot.axis(joint)[2]) > UPRIGHT)


def _base_top(robot: Robot, hulls: Mapping[str, Any]) -> float:
    """Return the top of the first link with geometry, or of the largest fixed to the root."""
    fixed = {robot.links[0]}
    for joint in robot.joints:
        if joint.parent in fixed and not joint.moves:
            fixed.add(joint.child)
    first = next(link for link in robot.links if link in hulls)
    best, top = -1.0, 0.0
    for link in robot.links:
        if link in fixed and link in hulls:
            size = np.ptp(hulls[link], axis=0)
            if size[0] * size[1] > best:
                best, top = float(size[0] * size[1]), float(hulls[link][:, 2].max())
    return max(top, float(hulls[first][:, 2].max())) if first in fixed else top


def _carries(
    robot: Robot, link: str, tops: Mapping[str, float], limit: float, joint: Joint
) -> bool:
    """Return whether a link that this joint moves reaches above the base: an arm, not a wheel."""
    if not joint.moves:
        return False
    members = {link}
    for below in robot.joints:
        if below.parent in members:
            members.add(below.child)
    return any(tops.get(member, -np.inf) > limit for member in members)


def _limb_names(limbs: list[str], of: Mapping[str, str]) -> dict[str, str]:
    names: dict[str, str] = {}
    for limb in limbs:
        members = [link for link, part in of.items() if part == limb]
        kind = "head" if any("head" in link for link in members) else "arm"
        side = next(
            (s for s in ("left", "right") if s in limb or limb.startswith(f"{s[0]}_")), None
        )
        name = kind if side is None else f"{side}_{kind}"
        taken, number = set(names.values()), 2
        while name in taken:
            name, number = f"{kind}_{number}", number + 1
        names[limb] = name
    return names
