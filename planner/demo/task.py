"""The task of Figure 4 (Deeken et al.), planned, and carried out by a simulated robot."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from planner.demo.office import delivery_robot
from planner.live_topology import LiveTopology
from planner.mission.mission_store import MissionStore
from planner.mission.runner import MissionEvent, MissionResult, Runner
from planner.mission.sim_setup import entry_pose, open_world, simulated_robot
from planner.plan import Plan
from planner.readers.robot_class import store_robot_class
from planner.task_planner import TaskPlanner
from semmap import cli

__all__ = ["put_back", "task_demo"]

GOAL, START, TIMES = "on(muffin, desk1)", "lab1", 60.0
"""What the robot shall do, where it begins, and how much faster than real it does."""

_BACK = """
UPDATE placement p SET holder_id = h.holder_id, pose = h.pose, relation = h.relation
FROM entity e, entity d, placement_history h
WHERE e.id = p.entity_id AND e.map_id = current_map() AND e.name = 'muffin1'
  AND d.map_id = e.map_id AND d.name = 'desk4' AND h.entity_id = e.id AND h.holder_id = d.id
  AND p.holder_id <> d.id
  AND lower(h.during) = (SELECT max(lower(l.during)) FROM placement_history l
                         WHERE l.entity_id = e.id AND l.holder_id = d.id)
"""
"""To where the example has the muffin, and so the README, and whoever runs this next."""


def task_demo(map_name: str, folder: Path, say: Callable[..., Any]) -> MissionResult:
    """Let the delivery robot bring a muffin to desk1, and tell what it does."""
    robot = delivery_robot()
    with cli.database() as engine:
        with engine.begin() as connection:
            cli.choose_map(connection, map_name)
            store_robot_class(connection, robot)
        live = LiveTopology(engine, map_name, robot.name)
        planner = TaskPlanner(live)

        def plan(*arguments: Any, **options: Any) -> Plan:
            found = planner(*arguments, **options)
            if found.actions:  # none where it is reached
                say(f"   {GOAL}: " + " · ".join(map(str, found.actions)))
            return found

        def on_event(event: MissionEvent) -> None:
            if event.kind == "failed":
                say(f"   {event.command or 'it'} failed: {event.message}")

        file = folder / "simulation.sqlite"
        file.unlink(missing_ok=True)
        with MissionStore(engine, map_name, "demo") as store:
            store.add_robot("robot", START, entry_pose(live.topology, START), robot.name)
            with closing(open_world(file, store, live.topology, "robot")) as world:
                body = simulated_robot(live, world, "robot", speed=TIMES)
                runner = Runner(store, body, plan, speed=TIMES, tick=1 / TIMES, on_event=on_event)
                result = runner.run(store.add("robot", GOAL))
                steps = store.steps(result.mission)
        say(f"   {result.state}: {len(steps)} steps by a simulated robot{_because(result)}")
        return result


def put_back(map_name: str) -> bool:
    """Put the muffin on desk4 again, if a robot took it away; whether one did."""
    with cli.database() as engine, engine.begin() as connection:
        cli.choose_map(connection, map_name)
        return connection.exec_driver_sql(_BACK).rowcount > 0


def _because(result: MissionResult) -> str:
    return f": {result.reason}" if result.reason else ""
