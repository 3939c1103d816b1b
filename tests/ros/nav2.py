"""A simulator of Nav2's action server ``navigate_to_pose``: it drives in straight lines.

Run by a Python that has rclpy: ``nav2.py X Y Z FILE``. It publishes ``amcl_pose``, latched. Further
goals replace the present one. The file says how it serves: drive, refuse, abort, or freeze, which
neither moves nor answers.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import Pose, PoseWithCovarianceStamped
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

SPEED, TICK = 4.0, 0.02  # m/s, seconds


class Nav2(Node):  # type: ignore[misc]
    """The simulator."""

    def __init__(self, x: float, y: float, z: float, file: Path) -> None:
        super().__init__("nav2")
        self.pose, self.file = Pose(), file
        self.present: Any = None
        at = self.pose.position
        at.x, at.y, at.z = x, y, z
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.sender = self.create_publisher(PoseWithCovarianceStamped, "amcl_pose", latched)
        ActionServer(
            self,
            NavigateToPose,
            "navigate_to_pose",
            self.drive,
            goal_callback=self.judge,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),
        )
        self.publish()

    @property
    def mode(self) -> str:
        """How it serves now."""
        return self.file.read_text()

    def judge(self, _: Any) -> GoalResponse:
        """Accept or refuse a goal."""
        return GoalResponse.REJECT if self.mode == "refuse" else GoalResponse.ACCEPT

    def publish(self) -> None:
        """Publish the pose."""
        message = PoseWithCovarianceStamped()
        message.header.frame_id = "map"
        message.header.stamp = self.get_clock().now().to_msg()
        message.pose.pose = self.pose
        self.sender.publish(message)

    def drive(self, goal: Any) -> Any:
        """Drive to a goal."""
        self.present = goal
        result = NavigateToPose.Result()
        target = goal.request.pose.pose
        while True:
            time.sleep(TICK)
            if goal.is_cancel_requested:
                goal.canceled()
                return result
            if self.mode == "freeze":
                continue
            if self.present is not goal or self.mode == "abort":
                goal.abort()
                result.error_code, result.error_msg = 9000, "a cat is in the way"
                return result
            a, b = self.pose.position, target.position
            left = math.dist((a.x, a.y), (b.x, b.y))
            share = 1.0 if left <= SPEED * TICK else SPEED * TICK / left
            a.x, a.y, a.z = a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), b.z
            self.publish()
            feedback = NavigateToPose.Feedback(distance_remaining=left)
            feedback.current_pose.header.frame_id = "map"
            feedback.current_pose.pose = self.pose
            goal.publish_feedback(feedback)
            if share == 1.0:
                self.pose.orientation = target.orientation
                self.publish()
                goal.succeed()
                return result


def main() -> None:
    """Serve until standard input ends."""
    rclpy.init()
    executor = MultiThreadedExecutor(8)
    x, y, z = map(float, sys.argv[1:4])
    executor.add_node(Nav2(x, y, z, Path(sys.argv[4])))

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    sys.stdin.read()
    rclpy.shutdown()
    thread.join(5)


if __name__ == "__main__":
    main()
