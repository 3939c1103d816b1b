"""The task of Figure 4 (Deeken et al.), carried out by a simulated robot, and a search."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from planner.mission.runner import MissionEvent
from planner.readers.entity_lookup import find_entities
from planner.readers.robot_class import store_robot_class
from planner.robot_class import RobotClass
from planner.simulated_run import SimulatedMission
from planner.topology import OUTSIDE, Topology
from semmap.api.map import Map
from semmap.cli.demo.choices import DemoChoices
from semmap.draw.view import StoreyView

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
) -> SimulatedMission | None:
    """Let a robot bring the chosen object to a table, in a copy of the map; `then` gets the copy.

    Without an object, or a plan for it, the robot drives to another room. None if that is
    impossible as well.
    """
    with house.engine.begin() as connection:
        store_robot_class(connection, robot)
    file = folder / "simulation.sqlite"
    file.unlink(missing_ok=True)
    reasons: list[str] = []
    for start, goal in itertools.islice(tasks(house.topology(), choices), MOST):
        try:
            plan = house.plan(goal, start=start, robot=robot.name)
            actions = " · ".join(map(str, plan.actions)) or "is reached"
            for line in (*reasons, f"{goal}: {actions}".replace('"', "")):
                say(f"   {line}")
            reasons.clear()
            result = house.run(
                goal,
                start=start,
                robot=robot.name,
                speed=TIMES,
                world=file,
                try_grasps=False,
                on_event=lambda event: _say_failure(event, say),
            )
        except (ValueError, LookupError) as error:
            reasons.append(f"{goal} from {start}: {error}")
            continue
        reason = f": {result.reason}" if result.reason else ""
        say(f"   {result.state}: {len(result.steps)} steps by a simulated robot{reason}")
        then(house.database.map(result.map))
        return result
    for reason in reasons:
        say(f"   {reason}")
    say("   none: the map has no rooms that doors join, or this robot reaches none of those tried")
    return None


def _say_failure(event: MissionEvent, say: Callable[..., Any]) -> None:
    if event.kind == "failed":
        say(f"   {event.command or 'it'} failed: {event.message}")


def tasks(topology: Topology, choices: DemoChoices) -> Iterator[tuple[str, str]]:
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
        here = topology.places[start].storey
        same = [room for room in reversed(rooms) if topology.places[room].storey == here]
        others = [room for room in reversed(rooms) if room not in same]
        for room in filter(None, itertools.chain(*itertools.zip_longest(others, same))):
            if room != start:
                yield start, f'in(robot, "{room}")'


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
    for storey in storeys:
        if {v.room for v in tour[:1]} & {room.name for room in storey.rooms}:
            shown = storey.name if len(storeys) > 1 else None
            return [found.plot(shown).save(folder / "search.png")]
    return []
