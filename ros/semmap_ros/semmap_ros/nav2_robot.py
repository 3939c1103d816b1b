"""A robot that drives by the action ``navigate_to_pose`` of Nav2."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from navgrid.grid import ROOT_FRAME
from planner.mission.behaviours import Outcome, RobotObservation
from planner.mission.command import Command
from planner.mission.store.mission_list import MissionError
from semmap.geometry.pose import Pose
from semmap_ros.messages import pose_message
from semmap_ros.optional import NavigateToPose

ABOVE = 0.05  # metres: a pose at a floor is looked up this much above it
STEP = 0.02  # seconds between two looks at an answer for which a call waits
SLOWER = 10.0  # how many times longer than planned a drive may last, beside the patience


class Nav2Robot:
    """The behaviours of a robot that Nav2 drives; a class of a robot with an arm extends it.

    It needs a thread that spins the node. Poses come from the topic ``amcl_pose``, in the frame
    ``map`` or in that of a storey. A drive that is slower than `SLOWER`, or that gives no feedback
    for `patience` seconds, is stopped and counts as blocked.

    Attributes
    ----------
    floors
        The heights of the frames of storeys, metres.
    place_at
        The name of the room of a pose, or None.
    place
        The room in which the robot was last; poses on thresholds have none of their own.
    """

    def __init__(
        self,
        node: Node,
        floors: dict[str, float],
        place_at: Callable[[Pose], str | None],
        place: str | None = None,
        patience: float = 10.0,
    ) -> None:
        if NavigateToPose is None:
            raise MissionError("nav2_msgs is not installed: run scripts/ros_messages")
        self.node, self.patience = node, patience
        self._floors, self.place_at, self._place = floors, place_at, place
        self._pose: Pose | None = None
        self._drive: Drive | None = None
        self.client = ActionClient(node, NavigateToPose, "navigate_to_pose")
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for durability in (latched, QoSProfile(depth=1)):  # of a sender that is not latched, too
            node.create_subscription(
                PoseWithCovarianceStamped,
                "amcl_pose",
                lambda message: self.note(message.header.frame_id, message.pose.pose),
                durability,
            )

    def note(self, frame: str, pose: Any) -> None:
        """Note where the robot is."""
        if frame != ROOT_FRAME and frame not in self._floors:
            self.node.get_logger().error(
                f"a pose is in the frame {frame!r}, which the map lacks: set global_frame_id",
                throttle_duration_sec=5.0,
            )
            return
        at, turn = pose.position, pose.orientation
        height = self._floors.get(frame, 0.0)
        self._pose = Pose(at.x, at.y, at.z + height, turn.x, turn.y, turn.z, turn.w)

    def observe(self) -> RobotObservation:
        """Where the robot is; MissionError where nothing says so in `patience` seconds."""
        wait_until(lambda: self._pose is not None, self.patience)
        pose = self._pose
        if pose is None:
            raise MissionError(
                f"no pose came in {self.patience:g} s: publish amcl_pose in the frame {ROOT_FRAME}"
            )
        self._place = self.place_at(pose._replace(z=pose.z + ABOVE)) or self._place
        if self._place is None:
            raise MissionError(f"no room holds ({pose.x:.2f}, {pose.y:.2f}): localise the robot")
        return RobotObservation(self._place, pose)

    def navigate(self, command: Command) -> Drive:
        """Drive to `command.step.leave`."""
        assert command.step is not None
        goal = NavigateToPose.Goal()
        goal.pose = PoseStamped(pose=pose_message(command.step.leave))
        goal.pose.header.frame_id = ROOT_FRAME
        goal.pose.header.stamp = self.node.get_clock().now().to_msg()
        self._drive = Drive(self, goal, SLOWER * command.seconds + self.patience)
        return self._drive

    pass_door = drive_through = navigate

    def switch_map(self, command: Command) -> Done:
        """Nothing is to be done: the node publishes the map of the storey of its agent."""
        return Done()

    def stop(self) -> None:
        """Stop the present drive."""
        if self._drive is not None:
            self._drive.cancel()


class Done:
    """A behaviour that has ended."""

    def poll(self) -> Outcome:
        """How it ended."""
        return Outcome()

    def cancel(self) -> None:
        """Nothing runs."""


class Drive:
    """A goal of Nav2, from the search for its server to its result."""

    def __init__(self, robot: Nav2Robot, goal: Any, limit: float) -> None:
        self._robot, self._goal, self._limit = robot, goal, limit
        self._begun = self._heard = time.monotonic()
        self._sent: Any = None
        self._result: Any = None
        self._outcome: Outcome | None = None

    def poll(self) -> Outcome | None:
        """How it ended; None while it runs."""
        if self._outcome is None:
            self._outcome = self._look()
        return self._outcome

    def cancel(self) -> None:
        """Cancel the goal; returns when Nav2 has stopped, or after `patience` seconds."""
        if self._outcome is None:
            self._outcome = Outcome("cancelled", "the drive was cancelled")
            self._stop()

    def _look(self) -> Outcome | None:
        """Send the goal when there is a server, then wait for its answers."""
        if self._sent is None:
            if self._robot.client.server_is_ready():
                self._sent = self._robot.client.send_goal_async(self._goal, self._hear)
                self._heard = time.monotonic()
            elif self._silent():
                return Outcome("unable", "nothing serves navigate_to_pose: start Nav2")
            return None
        if self._result is None and self._sent.done():
            if not self._sent.result().accepted:
                return Outcome("blocked", "Nav2 refused the goal")
            self._result = self._sent.result().get_result_async()
        if self._result is not None and self._result.done():
            return self._ended(self._result.result())
        if self._silent():
            self._stop()
            return Outcome("blocked", f"Nav2 sent nothing for {self._robot.patience:g} s")
        if time.monotonic() > self._begun + self._limit:
            self._stop()
            return Outcome("blocked", f"the drive lasted over {self._limit:.0f} s: it was stopped")
        return None

    def _ended(self, answer: Any) -> Outcome:
        seconds = time.monotonic() - self._begun
        if answer.status == GoalStatus.STATUS_SUCCEEDED:
            return Outcome(seconds=seconds)
        if answer.status == GoalStatus.STATUS_CANCELED:
            return Outcome("blocked", "another client cancelled the drive", seconds)
        error = getattr(answer.result, "error_msg", "")  # since Kilted
        code = getattr(answer.result, "error_code", 0)  # since Iron
        why = error or (f"error {code}" if code else "no reason given")
        return Outcome("blocked", f"Nav2 gave up: {why}", seconds)

    def _hear(self, message: Any) -> None:
        self._heard = time.monotonic()
        at = message.feedback.current_pose
        if at.header.frame_id:
            self._robot.note(at.header.frame_id, at.pose)

    def _silent(self) -> bool:
        return time.monotonic() > self._heard + self._robot.patience

    def _stop(self) -> None:
        """Cancel the goal, and wait for its end."""
        patience = self._robot.patience
        if self._sent is None:
            return
        if wait_until(self._sent.done, patience) and self._sent.result().accepted:
            ended = self._result or self._sent.result().get_result_async()
            self._sent.result().cancel_goal_async()
            if wait_until(ended.done, patience):
                return
        elif self._sent.done():
            return
        self._robot.node.get_logger().error(
            f"Nav2 did not confirm in {patience:g} s that the robot stands: look at it"
        )


def wait_until(holds: Callable[[], bool], seconds: float) -> bool:
    """Wait until a condition holds; whether it does in time."""
    end = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(STEP)
    return True
