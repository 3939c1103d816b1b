"""The node: a life cycle around a map that is open, its topics and its services.

What touches the map runs in the thread of the executor. The thread of the subscription only notes
what changed, and that of the topics only reads large states: both wake that one.
"""

from __future__ import annotations

import gc
import sys
from collections import deque
from collections.abc import Callable
from typing import Any

import psycopg
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from sqlalchemy.exc import DBAPIError

import semmap
from semmap.api.map_events import MapSubscription
from semmap_ros.detections import MapDetections
from semmap_ros.robot_inputs import RobotInputs
from semmap_ros.services import MapServices
from semmap_ros.topics import MapTopics

PARAMETERS: dict[str, Any] = {
    "map": "",
    "url": "",
    "storeys": [""],
    "robot": "",
    "agent": "",
    "resolution": 0.05,
    "interval": [0.05, 1.8],
    "fields": [""],
    "route_graph": "",
    "pose_arrays": [""],
    "joint_states": "",
    "scanned_grid": "",
    "oldest": 10.0,
    "period": 1.0,
    "autostart": True,
}

EXPECTED = (semmap.Error, ValueError, psycopg.Error, DBAPIError)
"""Errors of wrong arguments, and of a database or map that is away; others are defects."""

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class MapNode(LifecycleNode):  # type: ignore[misc]
    """The node ``semmap``: configured it has the map open, active it publishes and answers."""

    def __init__(self, **options: Any) -> None:
        super().__init__("semmap", **options)
        for name, value in PARAMETERS.items():
            self.declare_parameter(name, value)
        self.topics = MapTopics(self)
        self.problems: deque[str] = deque(maxlen=5)
        """The last refusals, the newest last."""
        self.refused = 0
        self._map: semmap.Map | None = None
        self._subscription: MapSubscription | None = None
        self._events: deque[Any] = deque()
        self._wanted = False  # whether it becomes active again when it can
        self._error = ""
        self._changed = self.create_guard_condition(self._follow)
        self.was_read = self.create_guard_condition(self._show)
        """Wakes the executor when the topics have read a state of the map."""
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._answers = MapServices(self)
        self._taken = MapDetections(self)
        self.robot_inputs = RobotInputs(self)
        # Neither a jump of the clock nor a simulation that stands still delays this.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self.value("period"), self._look, clock=steady)
        if self.value("autostart"):
            self.start()

    def value(self, name: str) -> Any:
        """The value of a parameter."""
        return self.get_parameter(name).value

    @property
    def state(self) -> str:
        """The state of the life cycle, such as ``active``."""
        return str(self._state_machine.current_state[1])

    @property
    def map(self) -> semmap.Map:
        """The map; ValueError while the node is not active."""
        if self._map is None or self._subscription is None:
            raise ValueError(f"the node is {self.state}: activate it first")
        return self._map

    @property
    def is_active(self) -> bool:
        """Whether it publishes and answers."""
        return self._subscription is not None

    def start(self) -> None:
        """Configure and activate it; `_look` does so again while the database is away."""
        self._wanted = True
        if self.state == "unconfigured":
            self.trigger_configure()
        if self.state == "inactive":
            self.trigger_activate()

    def attempt(self, what: str, step: Callable[[], object]) -> str:
        """Carry out a message's request; return the error, which diagnostics report, or ""."""
        try:
            step()
        except EXPECTED as error:
            self.refused += 1
            self.problems.append(f"{what}: {error}")
            self.get_logger().warning(self.problems[-1], throttle_duration_sec=5.0)
            return str(error)
        return ""

    # --- transitions

    def on_configure(self, _: Any) -> TransitionCallbackReturn:
        """Open the map; where that fails, it stays unconfigured."""
        return self._try(self._open)

    def on_activate(self, _: Any) -> TransitionCallbackReturn:
        """Publish all, and follow the changes; where that fails, it stays inactive."""
        return self._try(self._begin)

    def on_deactivate(self, _: Any) -> TransitionCallbackReturn:
        """Close the map; the last messages stay."""
        self._end()
        self._wanted = False
        return SUCCESS

    def on_cleanup(self, _: Any) -> TransitionCallbackReturn:
        """Close the map, and withdraw the last messages."""
        self._end()
        self.topics.withdraw()
        self._answers.offer(set())
        return SUCCESS

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """As `on_cleanup`."""
        return self.on_cleanup(state)

    def _try(self, step: Callable[[], object]) -> TransitionCallbackReturn:
        try:
            step()
        except EXPECTED as error:
            self._end()
            self._say(str(error))
            return FAILURE
        self._say("")
        return SUCCESS

    def connect(self) -> semmap.Database:
        """Open the database of the parameter ``url``."""
        return semmap.connect(self.value("url") or None)

    def _open(self) -> semmap.Map:
        if self._map is None:
            database = self.connect()
            try:
                self._map = database.map(self.value("map") or None)
            except BaseException:
                database.close()
                raise
        return self._map

    def _begin(self) -> None:
        found = self._open()
        subscription = found.subscribe(self._note)
        try:
            self.topics.publish(found)
            self._answers.offer(self.topics.storeys)
            gc.freeze()  # a full collection of these objects would delay moves for 0.2 s
        except BaseException:
            subscription.stop()
            raise
        self._subscription = subscription

    def _end(self) -> None:
        subscription, self._subscription = self._subscription, None
        found, self._map = self._map, None
        if subscription is not None and subscription.running:
            subscription.stop()
        self.topics.stop()
        if found is not None:
            found.database.close()
        self._events.clear()

    # --- changes and failures

    def _note(self, event: Any) -> None:
        self._events.append(event)
        self._changed.trigger()

    def _follow(self) -> None:
        events = [self._events.popleft() for _ in range(len(self._events))]
        if self.is_active and events:
            self._guarded(lambda: self.topics.follow(self.map, events))

    def _show(self) -> None:
        if self.is_active:
            self._guarded(self.topics.show_read)
            self._answers.offer(self.topics.storeys)

    def _look(self) -> None:
        """Look whether the map can be read, or try again to reach it; tell the state."""
        if self.is_active:
            self._guarded(self._check)
        elif self._wanted:
            self.start()
        self._tell()

    def _check(self) -> None:
        if self._subscription is not None and self._subscription.error is not None:
            raise self._subscription.error
        self.map.execute("SELECT 1")  # fails where the server has ended the session

    def _guarded(self, step: Callable[[], object]) -> None:
        """Become inactive where a step fails; `_look` starts again."""
        try:
            step()
        except EXPECTED as error:
            self.trigger_deactivate()
            self._wanted = True
            self._say(str(error))

    # --- diagnostics

    def _say(self, error: str) -> None:
        if error and error != self._error:
            self.get_logger().error(error)
        self._error = error
        self._tell()

    def _tell(self) -> None:
        """Publish the diagnostics."""
        level = DiagnosticStatus.OK
        if self._error or not self.is_active:
            level = DiagnosticStatus.ERROR if self._error else DiagnosticStatus.WARN
        values = {
            "state": self.state,
            "map": "" if self._map is None else self._map.name,
            "refused": str(self.refused),
            "last refused": " | ".join(self.problems),
        }
        status = DiagnosticStatus(
            level=level,
            name=f"{self.get_name()}: map",
            message=self._error or self.state,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


def main(arguments: list[str] | None = None) -> None:
    """Run the node until it is interrupted."""
    sys.setswitchinterval(1e-3)  # seconds: moves do not wait for the thread that reads grids
    rclpy.init(args=arguments)
    node = MapNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.on_shutdown(None)
        node.destroy_node()
        rclpy.try_shutdown()
