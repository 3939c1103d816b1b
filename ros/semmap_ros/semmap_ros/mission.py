"""Run a mission with a robot that Nav2 drives: ``python -m semmap_ros.mission GOAL``.

The parameter `behaviours` names a class, a subclass of `semmap_ros.nav2_robot.Nav2Robot`. Where the
database goes away, the robot stops, and the mission goes on when it is back.
"""

from __future__ import annotations

import argparse
import os
import socket
import sys
import threading
import time
from contextlib import ExitStack, closing
from importlib import import_module
from typing import Any

import psycopg
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from sqlalchemy.exc import DBAPIError

import semmap
from navgrid.grid import frame_name
from planner.live_topology import LiveTopology
from planner.mission.runner import MissionEvent, MissionResult, Runner
from planner.mission.store.mission_list import MissionError
from planner.mission.store.missions import LostMissionError, MissionStore
from planner.readers.robot_class import read_agent_class
from planner.task_planner import TaskPlanner
from planner.tasks.goal import parse_goal

PARAMETERS: dict[str, Any] = {
    "map": "",
    "url": "",
    "agent": "robot",
    "robot": "",
    "behaviours": "semmap_ros.nav2_robot.Nav2Robot",
    "patience": 10.0,  # seconds without an answer of Nav2
    "away": 60.0,  # seconds without the database
}

AWAY = (psycopg.Error, DBAPIError)
"""Errors of a database that is away."""


class MissionRun:
    """A mission of the robot of a node, over all restarts of the database."""

    def __init__(self, node: Node, goal: str | None, mission: int | None) -> None:
        self._node, self._goal, self.mission = node, goal, mission
        for name, value in PARAMETERS.items():
            node.declare_parameter(name, value)
        self._robot: Any = None

    def run(self) -> MissionResult:
        """Run it to its end; a database that is away for `away` seconds is raised."""
        since: float | None = None
        while True:
            try:
                return self._attempt()
            except AWAY as error:
                self.stop()
                now = time.monotonic()
                if since is None or now > since + 2 * self._value("away"):  # long after the last
                    since = now
                if now > since + self._value("away"):
                    raise
                self._node.get_logger().error(f"the database is away, the robot waits: {error}")
                time.sleep(1.0)

    def stop(self) -> None:
        """Stop the robot."""
        if self._robot is not None:
            self._robot.stop()

    def _value(self, name: str) -> Any:
        return self._node.get_parameter(name).value

    def _attempt(self) -> MissionResult:
        agent = self._value("agent")
        process = f"{socket.gethostname()} {os.getpid()}"
        with ExitStack() as opened:
            database = opened.enter_context(closing(semmap.connect(self._value("url") or None)))
            map = database.map(self._value("map") or None)
            store = opened.enter_context(MissionStore(map, process))
            live = LiveTopology(map, self._value("robot") or self._class_of(map, agent))
            known = store.robot(agent)
            if known is None:
                raise MissionError(f"there is no agent {agent} in a room of the map: add_agent")
            body = self._body(map, live, known[0])
            body.observe()  # what is refused leaves no mission behind
            if self.mission is None:
                assert self._goal is not None
                parse_goal(self._goal)
                self.mission = store.add(agent, self._goal)
            runner = Runner(store, body, TaskPlanner(live), on_event=self._tell)
            return runner.run(self.mission)

    def _class_of(self, map: semmap.Map, agent: str) -> str | None:
        with map.snapshot() as seen:
            return read_agent_class(seen, agent)

    def _body(self, map: semmap.Map, live: LiveTopology, place: str) -> Any:
        """The robot; it stays the same over restarts of the database."""
        if self._robot is None:
            module, _, own = self._value("behaviours").rpartition(".")
            floors = {frame_name(s.name): s.pose.z for s in map.storeys if s.pose is not None}
            made = getattr(import_module(module), own)
            self._robot = made(
                self._node, floors, live.lookup.place_at, place, self._value("patience")
            )
        self._robot.place_at = live.lookup.place_at
        return self._robot

    def _tell(self, event: MissionEvent) -> None:
        what = " ".join(str(part) for part in (event.command, event.message) if part)
        self._node.get_logger().info(f"mission {self.mission} {event.kind} {what}".rstrip())


def main(arguments: list[str] | None = None) -> int:
    """Run a mission; the exit status is 0 where it is done."""
    words = sys.argv if arguments is None else arguments
    parser = argparse.ArgumentParser(description="Run a mission with a robot that Nav2 drives.")
    parser.add_argument("goal", nargs="?", help="such as in(robot, kitchen)")
    parser.add_argument("--resume", type=int, metavar="MISSION", help="go on with this mission")
    given = parser.parse_args(remove_ros_args(words)[1:])
    if (given.goal is None) == (given.resume is None):
        parser.error("give either a goal or --resume MISSION")
    rclpy.init(args=words)
    node = rclpy.create_node("semmap_mission")
    thread = threading.Thread(target=_spin, args=(node,))
    thread.start()
    run = MissionRun(node, given.goal, given.resume)
    try:
        result = run.run()
    except (semmap.Error, ValueError, LookupError, LostMissionError, *AWAY) as error:
        node.get_logger().error(f"mission {run.mission} did not end: {error}")
        return 1
    else:
        print(f"mission {result.mission}: {result.state}", result.reason or "", flush=True)
        return 0 if result.state == "done" else 1
    finally:
        run.stop()
        rclpy.try_shutdown()
        thread.join()


def _spin(node: Node) -> None:
    try:
        rclpy.spin(node)
    except ExternalShutdownException:
        return


if __name__ == "__main__":
    sys.exit(main())
