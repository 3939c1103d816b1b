"""Which links of a robot are fixed to each other, and which chains of joints move on them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from semmap.arrays import Floats
from semmap.robot.urdf import Joint, Robot


class LinkTree:
    """Rigid groups of links, and the joints that move one against another."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.below: dict[str, list[Joint]] = {link: [] for link in robot.links}
        for joint in robot.joints:
            self.below[joint.parent].append(joint)
        self.group = {robot.links[0]: robot.links[0]}
        for joint in robot.joints:
            self.group[joint.child] = joint.child if joint.moves else self.group[joint.parent]

    def rigid(self, link: str) -> tuple[str, ...]:
        """All links that are fixed to a link."""
        return tuple(each for each in self.robot.links if self.group[each] == self.group[link])

    def moving(self, link: str) -> list[Joint]:
        """The joints that move other links against a link's rigid group."""
        return [j for each in self.rigid(link) for j in self.below[each] if j.moves]

    def chain(self, joint: Joint) -> list[Joint] | None:
        """The moving joints from a joint to the end; None where they branch or are no finger."""
        chain = [joint]
        while True:
            if chain[-1].type not in ("revolute", "prismatic"):
                return None
            below = self.moving(chain[-1].child)
            if not below:
                return chain
            if len(below) > 1:
                return None
            chain.append(below[0])

    def poses(self, palm: str, posture: Mapping[str, float]) -> dict[str, Floats]:
        """The poses of all links that hang on a palm, in its frame."""
        poses = {palm: np.eye(4)}
        for joint in self.robot.joints:
            if joint.parent in poses:
                poses[joint.child] = poses[joint.parent] @ self.robot.transform(joint, posture)
        return poses

    def jaws(self) -> list[str]:
        """Links on which a single link moves that nothing moves on."""
        found = []
        for link in dict.fromkeys(self.group.values()):
            moving = self.moving(link)
            if len(moving) == 1 and len(self.chain(moving[0]) or ()) == 1:
                found.append(moving[0].parent)
        return found

    def palms(self) -> list[str]:
        """Links with at least two moving chains, none of which branches."""
        found = []
        for link in dict.fromkeys(self.group.values()):
            moving = self.moving(link)
            if len(moving) > 1 and all(self.chain(joint) for joint in moving):
                found.append(moving[0].parent)
        return found


def fixed_vertical(robot: Robot, palm: str, frame: Floats) -> Floats | None:
    """The vertical (3,) in the grasp frame, if joints move the palm and none of them tilts it."""
    above = {joint.child: joint for joint in robot.joints}
    link, moving = palm, []
    while link in above:
        moving += [above[link]] if above[link].moves else []
        link = above[link].parent
    turning = [joint for joint in moving if joint.type != "prismatic"]
    if not moving or any(abs(robot.axis(joint)[2]) < 1 - 1e-6 for joint in turning):
        return None
    up: Floats = (robot.link_poses({}, [palm])[palm] @ frame)[2, :3]
    return up
