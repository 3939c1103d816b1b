"""The task of Figure 4 (Deeken et al.), carried out by a simulated robot, and a search."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from planner.live_topology import LiveTopology
from planner.mission.runner import MissionEvent, MissionResult, Runner
from planner.mission.sim_setup import entry_pose, open_world, simulated_robot
from planner.mission.store.mission_list import MissionError
from planner.mission.store.missions import MissionStore
from planner.mission.store.simulation_map import simulation_map
from planner.plan import Plan
from planner.readers.entity_lookup import find_entities
from planner.readers.robot_class import store_robot_class
from planner.robot_class import RobotClass
from planner.task_planner import TaskPlanner
from planner.topology import OUTSIDE, Topology
from semmap.api.map import Map
from semmap.cli.demo.choices import DemoChoices
from semmap.cli.demo.figures import search_picture
from semmap.draw.view import StoreyView
from semmap.query.map_handle import MapHandle

NAMED = 8
"""Number of viewpoints of a search that the demo names."""

TIMES = 60.0
"""How much faster than real the robot's clock runs."""

MOST = 6
"""Number of tasks that are tried until one has a plan."""


def task_demo(
    house: Map,
    choices: DemoChoices,
    robot: RobotClass,
    folder: Path,
    say: Callable[..., Any],
    then: Callable[[Map], None],
) -> MissionResult | None:
    """Let a robot bring the chosen object to a table, in a copy of the map; `then` gets the copy.

    Without an object, or a plan for it, the robot drives to another room. None if that is
    impossible as well.
    """
    engine = house.engine
    with simulation_map(engine, house.name) as copy:
        with engine.begin() as connection:
            store_robot_class(connection, robot)
        live = LiveTopology(MapHandle(engine, copy), robot.name)
        planner = TaskPlanner(live)
        reasons: list[str] = []
        for start, goal in _tasks(live.topology, choices):
            if len(reasons) == MOST:
                break
            try:
                with live.snapshot() as seen:
                    planner.task(seen, goal, start).plan()
            except (ValueError, LookupError) as error:
                reasons.append(f"{goal} from {start}: {error}")
                continue
            for reason in reasons:
                say(f"   {reason}")
            result = _drive(engine, live, planner, start, goal, folder, say)
            then(house.database.map(copy))
            return result
    for reason in reasons:
        say(f"   {reason}")
    say("   none: the map has no rooms that doors join, or this robot reaches no other one")
    return None


def _tasks(topology: Topology, choices: DemoChoices) -> Iterator[tuple[str, str]]:
    """Starts and goals in the order in which they are tried."""
    rooms = [
        name
        for name, place in topology.places.items()
        if name != OUTSIDE and place.elevator is None and topology.connectors_of(name)
    ]
    starts = [choices.start] if choices.start in rooms else []
    starts += [name for name in rooms if name not in (choices.place, *starts)]
    goals = [f'on("{choices.type}", "{name}")' for name in choices.onto if choices.type]
    for goal in goals:
        yield from ((start, goal) for start in starts[:1])
    for start in starts[:2]:
        yield from ((start, f'in(robot, "{room}")') for room in reversed(rooms) if room != start)


def _drive(
    engine: Any,
    live: LiveTopology,
    planner: TaskPlanner,
    start: str,
    goal: str,
    folder: Path,
    say: Callable[..., Any],
) -> MissionResult:
    name = live.graph.robot.name

    def plan(*arguments: Any, **options: Any) -> Plan:
        found = planner(*arguments, **options)
        if found.actions:  # none if the goal is reached
            text = goal.replace('"', "")
            say(f"   {text}: " + " · ".join(map(str, found.actions)))
        return found

    def on_event(event: MissionEvent) -> None:
        if event.kind == "failed":
            say(f"   {event.command or 'it'} failed: {event.message}")

    file = folder / "simulation.sqlite"
    file.unlink(missing_ok=True)
    with MissionStore(MapHandle(engine, live.map_name), "demo") as store:
        try:
            pose = entry_pose(live.graph, start)
        except MissionError as error:
            return MissionResult(0, "failed", str(error))
        store.add_robot("robot", start, pose, name)
        with closing(open_world(file, store, live.topology, "robot")) as world:
            body = simulated_robot(live, world, "robot", speed=TIMES)
            runner = Runner(store, body, plan, speed=TIMES, tick=1 / TIMES, on_event=on_event)
            result = runner.run(store.add("robot", goal))
            steps = store.steps(result.mission)
    reason = f": {result.reason}" if result.reason else ""
    say(f"   {result.state}: {len(steps)} steps by a simulated robot{reason}")
    return result


def search_demo(
    house: Map,
    choices: DemoChoices,
    storeys: Sequence[StoreyView],
    folder: Path,
    say: Callable[..., Any],
) -> list[Path]:
    """Say where to look for the chosen object first and why (O'Neill, section 4.4.2); draw it."""
    places = house.topology().places.items()
    rooms = [name for name, place in places if name != OUTSIDE and place.elevator is None]
    if choices.type is None or not rooms:
        say("   none: the map has no small object on a table, or no room")
        return []
    start = choices.start if choices.start in rooms else rooms[0]
    with house.snapshot() as seen:
        name = find_entities(seen, choices.type)[0].name
    try:
        found = house.search(name, start=start)
    except ValueError as error:
        say(f"   none: {error}")
        return []
    say(f"   {found.reason}")
    tour = list({view.name: view for view in found.tour}.values())
    names = ", ".join(v.name for v in tour[:NAMED])
    more = f" and {len(tour) - NAMED} more" if len(tour) > NAMED else ""
    say(f"   until it is seen: {names or 'no look'}{more}")
    picture, title = folder / "search.png", f"{house.name}: where to look for {name}, from {start}"
    for storey in storeys:
        if {v.room for v in tour[:1]} & {room.name for room in storey.rooms}:
            return [search_picture(storey, found.problem, found.decision, picture, title)]
    return []
