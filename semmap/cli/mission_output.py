"""Missions of simulated robots as text for the terminal, and as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

import typer

from semmap import cli

if TYPE_CHECKING:
    from planner.mission.runner import MissionEvent
    from planner.simulated_run import SimulatedMission


def say(text: str) -> None:
    """Print a note."""
    cli.out.print(text, style="cyan")


def show_event(event: MissionEvent) -> None:
    """Print an event of a runner as a line."""
    number = "" if event.number is None else f"{event.number:>4}"
    if event.kind == "planned":
        cli.out.print(f"plan: {event.message}", style="dim")
    elif event.kind == "ended":
        message = f": {event.message}" if event.message else ""
        cli.out.print(f"{number} {event.command}{message}")
    elif event.kind == "failed" and event.command is not None:
        cli.out.print(f"{number} {event.command}: {event.message}", style="yellow")
    elif event.kind == "waits":
        cli.out.print(f"{number} waits: {event.message}", style="dim")
    elif event.command is None:
        message = f": {event.message}" if event.message else ""
        cli.out.print(f"{event.kind}{message}", style="bold")


def show_mission(ended: SimulatedMission, json_: bool) -> None:
    """Print how a mission ended; exit with 1 where it did not reach its goal."""
    if json_:
        value = {
            "mission": ended.mission,
            "state": ended.state,
            "reason": ended.reason,
            "world": str(ended.world),
            "steps": ended.steps,
            "map": ended.map,
        }
        if ended.assumed:
            value["assumed_sizes"] = ended.assumed
        if ended.found:
            value["found"] = {name: asdict(answer) for name, answer in ended.found.items()}
        print(json.dumps(value, default=str))
    else:
        _show_found(ended)
        if ended.map != ended.original:
            where = f"in {ended.map}; {ended.original} is unchanged (--apply changes it)"
            cli.out.print(where, style="dim")
    if not ended.done:
        raise typer.Exit(1)


def _show_found(ended: SimulatedMission) -> None:
    from planner.search.problem_builder import ELSEWHERE

    for name, answer in ended.found.items():
        if answer.place == ELSEWHERE:
            continue
        looks = "1 look" if answer.looks == 1 else f"{answer.looks} looks"
        how = f"seen there, after {looks}" if answer.seen else "not seen there"
        cli.out.print(f"{name} is at {answer.place} ({answer.probability:.0%}; {how})")
