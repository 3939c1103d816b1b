"""`semmap run` and `semmap missions`: goals that robots pursue."""

from __future__ import annotations

import json
import os
import socket
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semmap import cli

if TYPE_CHECKING:
    from planner.mission.mission_list import MissionList
    from planner.mission.runner import MissionEvent, MissionResult

__all__ = ["missions_command", "run_command"]

_WORLDS = Path("out/missions")
"""Folder for the states of simulated worlds."""


def run_command(
    goal: Annotated[
        str | None, typer.Argument(help="on(muffin, desk1) and in(robot, kitchen), ...")
    ] = None,
    start: Annotated[
        str | None,
        typer.Option("--from", help="Room in which the robot starts; by default its room."),
    ] = None,
    robot: Annotated[str, typer.Option("--agent", help="Name of the robot in the map.")] = "robot",
    robot_class: Annotated[
        str | None, typer.Option("--robot", help="Class of the robot (semmap robot).")
    ] = None,
    simulate: Annotated[bool, typer.Option("--simulate", help="Simulate the robot.")] = False,
    speed: Annotated[
        float, typer.Option(help="Speed of the simulated clock; 1 is real time.")
    ] = 20.0,
    fail: Annotated[
        list[str] | None,
        typer.Option(help="'door5 locked', 'pickup fails twice', 'drop fails .1'"),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of random failures.")] = 0,
    world: Annotated[
        Path | None,
        typer.Option(help="File with the state of the simulation; several robots may share it."),
    ] = None,
    apply: Annotated[
        bool,
        typer.Option("--apply", help="Write what happens into the map; by default into a copy."),
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue a mission whose process has ended.")
    ] = False,
    mission: Annotated[
        int | None, typer.Option(help="Mission to resume; by default the oldest.")
    ] = None,
    domain_file: Annotated[
        Path | None, typer.Option("--domain", help="YAML file of additional actions.")
    ] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Let a robot pursue a goal, step by step, through failures and restarts."""
    if not simulate and not resume:
        raise typer.BadParameter(
            "the command line can only simulate a robot: add --simulate; for a real robot, use "
            "planner.mission.Runner with its behaviours"
        )
    if resume == (goal is not None):
        raise typer.BadParameter("give either a goal, or --resume")

    from planner.live_topology import LiveTopology
    from planner.mission.failures import FailureRule
    from planner.mission.mission_list import MissionList
    from planner.mission.mission_store import MissionStore
    from planner.mission.runner import Runner
    from planner.mission.sim_setup import entry_pose, open_world, simulated_robot
    from planner.mission.simulation_map import simulation_map
    from planner.task_planner import TaskPlanner
    from planner.tasks.domain_file import read_domain
    from planner.tasks.goal import parse_goal

    rules = [FailureRule.parse(text) for text in fail or ()]
    domain = None if domain_file is None else read_domain(domain_file)
    if goal is not None:
        parse_goal(goal, () if domain is None else domain.relations)
    process = f"{socket.gethostname()} {os.getpid()}"
    with cli.database() as engine, ExitStack() as opened_here:
        with MissionList(engine, map_name) as missions:
            original = happens_in = missions.map_name
            number = _resumed(missions, mission) if resume else None
            if number is not None:
                robot, happens_in = missions.robot_of(number), missions.map_of(number)
        if not (apply or resume):
            happens_in = opened_here.enter_context(simulation_map(engine, original, world))
        store = opened_here.enter_context(MissionStore(engine, happens_in, process))
        live = LiveTopology(engine, happens_in, robot_class)
        planner = TaskPlanner(live, domain)
        if start is not None:
            if number is not None:
                raise typer.BadParameter("a mission resumes where its robot is: leave out --from")
            live.topology.place(start)
            store.add_robot(robot, start, entry_pose(live.topology, start), robot_class)
        if number is None:
            assert goal is not None
            number = store.add(robot, goal)
        file = world or _WORLDS / f"{original}-{number}.sqlite"
        opened = open_world(file, store, live.topology, robot, rules, resume=resume)
        with closing(opened) as sim_world:
            runner = Runner(
                store,
                simulated_robot(live, sim_world, robot, speed=speed, seed=seed),
                planner,
                speed=speed,
                tick=min(0.05, 1.0 / speed),
                on_event=None if json_ else _show_event,
            )
            result = runner.run(number)
        steps = store.steps(number)
    if json_:
        print(json.dumps(_result_as_json(result, steps, file) | {"map": happens_in}, default=str))
    elif happens_in != original:
        cli.out.print(f"in {happens_in}; {original} is unchanged (--apply changes it)", style="dim")
    if result.state != "done":
        raise typer.Exit(1)


def missions_command(
    mission: Annotated[int | None, typer.Argument(help="Show the steps of this mission.")] = None,
    cancel: Annotated[
        int | None, typer.Option(help="Cancel this mission; its robot stops.")
    ] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """List missions, or the steps of one; cancel one."""
    from planner.mission.mission_store import MissionError, MissionStore

    with cli.database() as engine, MissionStore(engine, map_name) as store:
        if cancel is not None and not store.cancel(cancel):
            raise MissionError(
                f"mission {cancel} does not exist or has ended: `semmap missions` lists them"
            )
        missions = store.missions()
        rows = missions if mission is None else store.steps(mission)
        if mission is not None and mission not in {row["id"] for row in missions}:
            raise MissionError(f"there is no mission {mission}: `semmap missions` lists them")
    if json_:
        print(json.dumps(rows, default=str))
        return
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in rows[0] if rows else ():
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*(_readable(v) for v in row.values()))
    cli.out.print(table if rows else "none")


def _show_event(event: MissionEvent) -> None:
    """Print an event of a runner as a line."""
    number = "" if event.number is None else f"{event.number:>4}"
    if event.kind == "planned":
        cli.out.print(f"plan: {event.message}", style="dim")
    elif event.kind == "ended":
        cli.out.print(f"{number} {event.command}")
    elif event.kind == "failed" and event.command is not None:
        cli.out.print(f"{number} {event.command}: {event.message}", style="yellow")
    elif event.kind == "waits":
        cli.out.print(f"{number} waits: {event.message}", style="dim")
    elif event.command is None:
        message = f": {event.message}" if event.message else ""
        cli.out.print(f"{event.kind}{message}", style="bold")


def _result_as_json(
    result: MissionResult, steps: list[dict[str, Any]], world: Path
) -> dict[str, Any]:
    return {
        "mission": result.mission,
        "state": result.state,
        "reason": result.reason,
        "world": str(world),
        "steps": steps,
    }


def _readable(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return f"{value:%Y-%m-%d %H:%M:%S}" if hasattr(value, "strftime") else str(value)


def _resumed(missions: MissionList, mission: int | None) -> int:
    """The number of the mission to resume."""
    from planner.mission.map_connection import MissionError

    if mission is not None:
        return mission
    unfinished = missions.unfinished()
    if not unfinished:
        raise MissionError("there is no mission to resume: `semmap missions` lists them")
    return unfinished[0]
