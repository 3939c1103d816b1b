"""The task of Figure 4 (Deeken et al.), planned, and carried out by a simulated robot."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from navgrid.options import parts_of
from planner.live import Live
from planner.mission.journal import Journal
from planner.mission.planning import TaskPlanner
from planner.mission.runner import Event, Result, Runner
from planner.mission.simulation import entry, open_world, simulated_robot
from planner.plan import Plan
from planner.robot_class import RobotClass
from planner.source.robot_class import keep_robot_class
from semmap import cli

__all__ = ["put_back", "task_demo"]

GOAL, START, TIMES = "on(muffin, desk1)", "lab1", 60.0
"""What the robot shall do, where it begins, and how much faster than real it does."""

EXAMPLE = Path(__file__).parents[2] / "examples" / "office"

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


def task_demo(map_name: str, folder: Path, say: Callable[..., Any]) -> Result:
    """Let the delivery robot bring a muffin to desk1, and tell what it does."""
    shape = parts_of(EXAMPLE / "delivery_robot.urdf", None, EXAMPLE / "delivery_robot_parts.yaml")
    robot = RobotClass("delivery", tuple(shape), speed=0.8)
    with cli.database() as engine:
        with engine.begin() as connection:
            cli.choose_map(connection, map_name)
            keep_robot_class(connection, robot)
        live = Live(engine, map_name, robot.name)
        planner = TaskPlanner(live)

        def plan(*asked: Any, **more: Any) -> Plan:
            found = planner(*asked, **more)
            if found.actions:  # none where it is reached
                say(f"   {GOAL}: " + " · ".join(map(str, found.actions)))
            return found

        def hear(event: Event) -> None:
            if event.what == "failed":
                say(f"   {event.stage or 'it'} failed: {event.said}")

        world = folder / "simulation.sqlite"
        world.unlink(missing_ok=True)
        with Journal(engine, map_name, "demo") as journal:
            journal.add_robot("robot", START, entry(live.topology, START), robot.name)
            with closing(open_world(world, journal, live.topology, "robot")) as truth:
                body = simulated_robot(live, truth, "robot", speed=TIMES)
                runner = Runner(journal, body, plan, speed=TIMES, tick=1 / TIMES, hear=hear)
                result = runner.run(journal.add("robot", GOAL))
                steps = journal.steps(result.mission)
        say(f"   {result.state}: {len(steps)} steps by a simulated robot{_because(result)}")
        return result


def put_back(map_name: str) -> bool:
    """Put the muffin on desk4 again, if a robot took it away; whether one did."""
    with cli.database() as engine, engine.begin() as connection:
        cli.choose_map(connection, map_name)
        return connection.exec_driver_sql(_BACK).rowcount > 0


def _because(result: Result) -> str:
    return f": {result.reason}" if result.reason else ""
