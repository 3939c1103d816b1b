"""`semmap run`, `missions` and `search`: goals that robots pursue, and objects to look for."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer import Argument, Option

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of
from semmap.cli.options import Json
from semmap.cli.output import place_progress, print_folded

if TYPE_CHECKING:
    from planner.mission.runner import MissionEvent
    from planner.simulated_run import SimulatedMission
    from semmap.api.map_results import ObjectSearch


@command_of(
    "Map.run",
    goal="[GOAL]",
    start="--from",
    simulate=None,
    try_grasps="--try-grasps/--assume-grasps",
)
def run_command(
    call: MethodCall,
    simulate: bool = Option(False, "--simulate", help="Simulate the robot."),
    json_: Json = False,
) -> None:
    """Let a robot pursue a goal, step by step, through failures and restarts."""
    if not simulate and not call.values["resume"]:
        raise typer.BadParameter(
            "the command line can only simulate a robot: add --simulate; for a real robot, use "
            "planner.mission.Runner with its behaviours"
        )
    _show_mission(call(**_told(json_)), json_)


@command_of("Map.missions")
def missions_command(
    call: MethodCall,
    mission: int | None = Argument(None, help="Show the steps of this mission."),
    cancel: int | None = Option(None, help="Cancel this mission; its robot stops."),
    json_: Json = False,
) -> None:
    """List missions, or the steps of one; cancel one."""
    if cancel is not None:
        call.handle.cancel_mission(cancel)
    rows = call() if mission is None else call.handle.mission_steps(mission)
    if json_:
        print(json.dumps(rows, default=str))
    elif rows:
        print_folded([*rows[0]], [[_readable(v) for v in row.values()] for row in rows])
    else:
        print("none")


def _readable(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return f"{value:%Y-%m-%d %H:%M:%S}" if hasattr(value, "strftime") else str(value)


@dataclass(frozen=True)
class Looks:
    """What a look costs and shows."""

    missed: float | None = Option(
        None, help="Seconds that it costs not to find the object; by default by the map."
    )
    sure: float = Option(0.95, help="Belief from which on the object is found at a place.")
    limit: float = Option(3600.0, help="Seconds after which a search ends.")
    hit: float = Option(0.9, help="P(seen | the object is in view).")
    false_alarm: float = Option(0.02, help="P(seen | it is not there).")
    look: float = Option(3.0, help="Seconds of a look.")
    camera_height: list[float] = Option(
        (), help="Of the camera, metres; repeatable. By default as the robot's URDF says, else 1.2."
    )
    camera_pitch: list[float] = Option(
        (), help="Of the camera, downwards, radians; repeatable. By default as the URDF says."
    )
    range_: float | None = Option(
        None, "--range", help="Metres within which it recognises objects; by default 3.5."
    )

    def arguments(self, call: MethodCall) -> dict[str, Any]:
        """The camera and the detector of `Map.search`: what is given in place of the robot's."""
        from planner.readers.robot_class import read_agent_class
        from planner.search.problem_builder import Detector
        from planner.search.reader import read_sight

        try:
            given: dict[str, Any] = {"furthest": self.range_} if self.range_ is not None else {}
            if self.camera_height:
                given["heights"] = tuple(self.camera_height)
            if self.camera_pitch:
                given["pitches"] = tuple(self.camera_pitch)
            sight = None
            if given:
                with call.handle.snapshot() as seen:
                    robot = call.values.get("robot") or read_agent_class(
                        seen, call.values.get("start")
                    )
                    sight = replace(read_sight(seen, robot)[0], **given)
            detector = Detector(
                self.hit, self.false_alarm, self.look, self.missed, self.sure, self.limit
            )
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None
        return {"sight": sight, "detector": detector}


@dataclass(frozen=True)
class Simulation:
    """What a simulated robot that searches does and meets."""

    agent: str = Option("robot", "--agent", help="Name of the robot in the map.")
    put: list[str] = Option(
        (), "--put", help="'mug on table1': where an object truly is; repeatable."
    )
    speed: float = Option(20.0, help="Speed of the simulated clock; 1 is real time.")
    fail: list[str] = Option((), help="'door5 locked', 'pickup fails twice'; repeatable.")
    seed: int = Option(0, help="Seed of random failures and detections.")
    world: Path | None = Option(
        None, help="File with the state of the simulation; several robots may share it."
    )
    apply: bool = Option(
        False, "--apply", help="Write what happens into the map; by default into a copy."
    )


@command_of("Map.search", start="--from")
def search_command(
    call: MethodCall,
    *,
    simulate: bool = Option(False, "--simulate", help="Let a simulated robot search."),
    looks: Looks,
    trials: int = Option(0, help="Compare so many random searches with other strategies."),
    pomdp: Path | None = Option(None, help="Write the search as a .pomdp file for other solvers."),
    simulation: Simulation,
    json_: Json = False,
) -> None:
    """Search for an object: say where to look first and why, or let a simulated robot do it."""
    seeing = looks.arguments(call)
    if simulate:
        name, told = call.values.pop("name"), vars(simulation) | _told(json_)
        _show_mission(call.handle.run(f'found("{name}")', **call.values, **told, **seeing), json_)
        return
    with place_progress(quiet=json_) as progress:
        search = call(progress=progress, **seeing)
    if pomdp is not None:
        search.write_pomdp(pomdp)
    if trials:
        found = search.compare(trials, simulation.seed)
        print(json.dumps(found)) if json_ else _show_trials(found)
    elif json_:
        print(json.dumps(search.as_json()))
    else:
        print(search.reason)
        _show_tour(search)
        for assumption in (search.assumed_body, search.assumed_camera):
            if assumption is not None:
                _say(assumption)


def _show_tour(search: ObjectSearch) -> None:
    lines = []
    for view in search.tour:
        shows = ", ".join(f"{place} {share:.0%}" for place, share in view.shows[:6])
        opens = f"open {view.opens}: " if view.opens else ""
        place = (f"{value:.2f}" for value in (view.pose.x, view.pose.y, view.aim.height))
        down = f"{math.degrees(view.aim.pitch):.0f}"
        lines.append((view.name, *place, down, opens + shows))
    if lines:
        print_folded(("look from", "x", "y", "camera", "down", "shows"), lines)


def _show_trials(found: dict[str, Any]) -> None:
    """Print how right and how fast the strategies are, as a table."""
    lines = [
        (
            case,
            name,
            _seconds(row["seconds"]),
            *(f"{row[key]:.0%}" for key in ("right", "found", "wrong", "missed")),
            *(_seconds(row.get(key)) for key in ("slower", "slower_if_right")),
        )
        for case, rows in found["cases"].items()
        for name, row in rows.items()
    ]
    shares = ("right", "found", "wrong", "missed")
    columns = ("object", "strategy", "seconds", *shares, "slower by seconds", "if both are right")
    print_folded(columns, lines)
    cli.out.print(
        f"{found['trials']} objects at {found['places']} places in turn, three searches each; "
        "means with 95 % confidence intervals",
        style="dim",
    )


def _seconds(interval: dict[str, float] | None) -> str:
    if interval is None:
        return ""
    return f"{interval['mean']:.0f} ({interval['low']:.0f} to {interval['high']:.0f})"


def _told(json_: bool) -> dict[str, Any]:
    """What `Map.run` calls with events and notes: they are printed, but not beside JSON."""
    return {} if json_ else {"on_event": _show_event, "say": _say}


def _say(text: str) -> None:
    """Print a note."""
    cli.out.print(text, style="cyan")


def _show_event(event: MissionEvent) -> None:
    """Print an event of a runner as a line."""
    number = "" if event.number is None else f"{event.number:>4}"
    message = f": {event.message}" if event.message else ""
    if event.kind == "planned":
        cli.out.print(f"plan{message}", style="dim")
    elif event.kind == "waits":
        cli.out.print(f"{number} waits{message}", style="dim")
    elif event.command is None:
        cli.out.print(f"{event.kind}{message}", style="bold")
    elif event.kind in ("ended", "failed"):
        style = "yellow" if event.kind == "failed" else None
        cli.out.print(f"{number} {event.command}{message}", style=style)


def _show_mission(ended: SimulatedMission, json_: bool) -> None:
    """Print how a mission ended; exit with 1 where it did not reach its goal."""
    if json_:
        print(json.dumps(ended.as_json(), default=str))
    else:
        _show_found(ended)
        if ended.map != ended.original:
            where = f"in {ended.map}; {ended.original} is unchanged (--apply changes it)"
            cli.out.print(where, style="dim")
    if not ended.done:
        raise typer.Exit(1)


def _show_found(ended: SimulatedMission) -> None:
    """Print where objects were found, or why they were not."""
    for name, result in ended.found.items():
        looks = "1 look" if result.looks == 1 else f"{result.looks} looks"
        how = f"seen there, after {looks}" if result.seen else f"not seen there in {looks}"
        cli.out.print(f"{name} is at {result.place} ({result.probability:.0%}; {how})")
    for result in ended.not_found.values():
        cli.out.print(result.reason, style="yellow")
