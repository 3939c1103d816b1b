"""What missions add to the command line: `semmap run` and `semmap missions`."""

from __future__ import annotations

import json
import os
import socket
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from planner.live import Live
from planner.mission.failures import FailureRule
from planner.mission.journal import Journal, MissionError
from planner.mission.planning import TaskPlanner
from planner.mission.runner import Event, Result, Runner
from planner.mission.simulation import entry, open_world, simulated_robot
from planner.tasks.domain_file import read_domain
from semmap import cli

__all__ = ["missions_command", "run_command"]

WORLDS = Path("out/missions")


def run_command(
    goal: Annotated[
        str | None, typer.Argument(help="on(muffin, desk1) and in(robot, kitchen), ...")
    ] = None,
    start: Annotated[
        str | None, typer.Option("--from", help="The room it starts in; else where the map has it.")
    ] = None,
    robot: Annotated[
        str, typer.Option("--agent", help="The robot of that name in the map.")
    ] = "robot",
    robot_class: Annotated[
        str | None, typer.Option("--robot", help="Its class: semmap robot.")
    ] = None,
    simulate: Annotated[bool, typer.Option("--simulate", help="A simulated robot.")] = False,
    speed: Annotated[float, typer.Option(help="How much faster than real its clock runs.")] = 20.0,
    fail: Annotated[
        list[str] | None,
        typer.Option(help="'door5 locked', 'pickup fails twice', 'drop fails .1'"),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of failures by chance.")] = 0,
    world: Annotated[
        Path | None,
        typer.Option(help="File with what is true in the simulation; several robots may share it."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on where a runner died.")] = False,
    mission: Annotated[int | None, typer.Option(help="Which to resume; else the oldest.")] = None,
    domain_file: Annotated[
        Path | None, typer.Option("--domain", help="Actions of your own, a YAML file.")
    ] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Let a robot pursue a goal, step by step, through failures and restarts."""
    if not simulate and not resume:
        raise typer.BadParameter(
            "no robot is here but a simulated one: add --simulate; a real one is driven through "
            "planner.mission.Runner with its behaviours"
        )
    if resume == (goal is not None):
        raise typer.BadParameter("say a goal, or --resume for one that was begun: one of them")
    rules = [FailureRule.parse(said) for said in fail or ()]
    domain = None if domain_file is None else read_domain(domain_file)
    me = f"{socket.gethostname()} {os.getpid()}"
    with cli.database() as engine, Journal(engine, map_name, me) as journal:
        number = _resumed(journal, mission) if resume else None
        if number is not None:
            robot = journal.robot_of(number)
        live = Live(engine, journal.map_name, robot_class)
        if start is not None:
            if number is not None:
                raise typer.BadParameter("a mission is resumed where its robot is: no --from")
            if start not in live.topology.places:
                live.topology.place(start)
            journal.add_robot(robot, start, entry(live.topology, start), robot_class)
        if number is None:
            assert goal is not None
            TaskPlanner(live, domain).check(goal)
            number = journal.add(robot, goal)
        file = world or WORLDS / f"{journal.map_name}-{number}.sqlite"
        opened = open_world(file, journal, live.topology, robot, rules, resume=resume)
        with closing(opened) as truth:
            runner = Runner(
                journal, simulated_robot(live, truth, robot, speed=speed, seed=seed),
                TaskPlanner(live, domain), speed=speed, tick=min(0.05, 1.0 / speed),
                hear=None if json_ else show,
            )  # fmt: skip
            result = runner.run(number)
        steps = journal.steps(number)
    if json_:
        print(json.dumps(_as_json(result, steps, file), default=str))
    if result.state != "done":
        raise typer.Exit(1)


def missions_command(
    mission: Annotated[int | None, typer.Argument(help="Show the steps of this one.")] = None,
    cancel: Annotated[int | None, typer.Option(help="Cancel this one; its robot stops.")] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """List missions, or the steps of one; cancel one."""
    with cli.database() as engine, Journal(engine, map_name) as journal:
        if cancel is not None and not journal.cancel(cancel):
            raise MissionError(f"mission {cancel} is not there, or has ended")
        rows = journal.missions() if mission is None else journal.steps(mission)
        if mission is not None and not rows and mission not in {
            row["id"] for row in journal.missions()
        }:  # fmt: skip
            raise MissionError(f"there is no mission {mission}: `semmap missions` lists them")
    if json_:
        print(json.dumps(rows, default=str))
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in rows[0] if rows else ():
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*(_readable(v) for v in row.values()))
    cli.out.print(table if rows else "none")


def show(event: Event) -> None:
    """What a runner says, as a line."""
    number = "" if event.number is None else f"{event.number:>4}"
    if event.what == "planned":
        cli.out.print(f"plan: {event.said}", style="dim")
    elif event.what == "ended":
        cli.out.print(f"{number} {event.stage}")
    elif event.what == "failed" and event.stage is not None:
        cli.out.print(f"{number} {event.stage}: {event.said}", style="yellow")
    elif event.what == "waits":
        cli.out.print(f"{number} waits: {event.said}", style="dim")
    elif event.stage is None:
        cli.out.print(f"{event.what}{': ' if event.said else ''}{event.said}", style="bold")


def _as_json(result: Result, steps: list[dict[str, Any]], world: Path) -> dict[str, Any]:
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


def _resumed(journal: Journal, mission: int | None) -> int:
    known = journal.unfinished()
    if mission is None and not known:
        raise MissionError("there is no mission to resume: `semmap missions` lists them")
    return known[0] if mission is None else mission
