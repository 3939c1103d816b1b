"""`semmap run`, `missions` and `search`: goals that robots pursue, and objects to look for."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer import Argument, Option

from semmap import cli
from semmap.cli import options
from semmap.cli.option_group import grouped
from semmap.cli.output import place_progress, print_folded

if TYPE_CHECKING:
    from planner.mission.runner import MissionEvent
    from planner.simulated_run import SimulatedMission
    from semmap.api.map_results import ObjectSearch


@dataclass(frozen=True)
class Actor:
    """Which robot acts, and where it starts."""

    start: str | None = Option(
        None, "--from", help="Room in which the robot starts; by default its room."
    )
    agent: str = Option("robot", "--agent", help="Name of the robot in the map.")
    robot: str | None = Option(None, "--robot", help="Class of the robot (semmap robot).")


@dataclass(frozen=True)
class Chance:
    """What happens in a simulated world, and how fast."""

    speed: float = Option(20.0, help="Speed of the simulated clock; 1 is real time.")
    fail: list[str] = Option(
        (), help="'door5 locked', 'Lift 1 broken', 'pickup fails twice', 'drop fails .1'"
    )
    seed: int = Option(0, help="Seed of random failures and detections.")


@dataclass(frozen=True)
class Written:
    """Where the state of the world and of the map goes."""

    world: Path | None = Option(
        None, help="File with the state of the simulation; several robots may share it."
    )
    apply: bool = Option(
        False, "--apply", help="Write what happens into the map; by default into a copy."
    )


PUT = Option((), "--put", help="'mug on table1': where an object truly is; repeatable.")


@grouped
def run_command(
    *,
    goal: str | None = Argument(None, help="on(muffin, desk1) and in(robot, kitchen), ..."),
    actor: Actor,
    simulate: bool = Option(False, "--simulate", help="Simulate the robot."),
    chance: Chance,
    put: list[str] = PUT,
    gripper: str | None = Option(
        None, help="Gripper of the robot; by default its own or the preferred one."
    ),
    written: Written,
    try_grasps: bool | None = Option(
        None,
        "--try-grasps/--assume-grasps",
        help="Try each grasp in simulation, by default where MuJoCo is installed; or assume "
        "that it succeeds and learn nothing.",
    ),
    assume_sizes: options.AssumeSizes = False,
    resume: bool = Option(False, "--resume", help="Continue a mission whose process has ended."),
    mission: int | None = Option(None, help="Mission to resume; by default the oldest."),
    domain_file: options.DomainFile = None,
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
    asked: Any = {"put": put, "gripper": gripper, "try_grasps": try_grasps, "resume": resume}
    asked |= {"mission": mission, "domain": domain_file, "assume_sizes": assume_sizes}
    asked |= vars(actor) | vars(chance) | vars(written) | _told(json_)
    with cli.chosen_map(map_name) as house:
        ended = house.run(goal, **asked)
    _show_mission(ended, json_)


def missions_command(
    mission: int | None = Argument(None, help="Show the steps of this mission."),
    cancel: int | None = Option(None, help="Cancel this mission; its robot stops."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """List missions, or the steps of one; cancel one."""
    with cli.chosen_map(map_name) as house:
        if cancel is not None:
            house.cancel_mission(cancel)
        rows = house.missions() if mission is None else house.mission_steps(mission)
    if json_:
        print(json.dumps(rows, default=str))
        return
    if rows:
        print_folded([*rows[0]], [[_readable(v) for v in row.values()] for row in rows])
    else:
        cli.out.print("none")


def _readable(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return f"{value:%Y-%m-%d %H:%M:%S}" if hasattr(value, "strftime") else str(value)


@dataclass(frozen=True)
class Looks:
    """What a look costs and shows."""

    wrong: float = Option(3600.0, help="What a wrong answer costs, seconds; more: longer looks.")
    hit: float = Option(0.9, help="P(seen | the object is in view).")
    false_alarm: float = Option(0.02, help="P(seen | it is not there).")
    look: float = Option(3.0, help="Seconds of a look.")
    camera_height: float = Option(1.2, help="Of the camera, metres.")
    range_: float = Option(3.5, "--range", help="Metres within which it recognises objects.")

    def arguments(self) -> dict[str, Any]:
        """The camera and the detector of `Map.search`."""
        from planner.search.problem_builder import Detector
        from planner.search.viewpoints import Sight

        try:
            sight = Sight(height=self.camera_height, furthest=self.range_)
            detector = Detector(self.hit, self.false_alarm, self.look, self.wrong)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None
        return {"sight": sight, "detector": detector}


@grouped
def search_command(
    *,
    name: str = Argument(help="Name of the object."),
    actor: Actor,
    simulate: bool = Option(False, "--simulate", help="Let a simulated robot search."),
    put: list[str] = PUT,
    looks: Looks,
    trials: int = Option(0, help="Compare so many random searches with other strategies."),
    pomdp: Path | None = Option(None, help="Write the search as a .pomdp file for other solvers."),
    chance: Chance,
    written: Written,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Search for an object: say where to look first and why, or let a simulated robot do it."""
    seeing = looks.arguments()
    with cli.chosen_map(map_name) as house:
        if simulate:
            asked: Any = vars(actor) | vars(chance) | vars(written) | _told(json_)
            _show_mission(house.run(f'found("{name}")', put=put, **asked, **seeing), json_)
            return
        with place_progress(quiet=json_) as progress:
            who: Any = {"start": actor.start, "robot": actor.robot}
            search = house.search(name, progress=progress, **who, **seeing)
    if pomdp is not None:
        search.write_pomdp(pomdp)
    if trials:
        found = search.compare(trials, chance.seed)
        print(json.dumps(found)) if json_ else _show_trials(found)
    elif json_:
        print(json.dumps(_search_as_json(search)))
    else:
        cli.out.print(search.reason)
        _show_tour(search)


def _show_tour(search: ObjectSearch) -> None:
    lines = []
    for view in search.tour:
        shows = ", ".join(f"{place} {share:.0%}" for place, share in view.shows[:6])
        opens = f"open {view.opens}: " if view.opens else ""
        lines.append((view.name, f"{view.pose.x:.2f}", f"{view.pose.y:.2f}", opens + shows))
    if lines:
        print_folded(("look from", "x", "y", "shows"), lines)


def _search_as_json(search: ObjectSearch) -> dict[str, Any]:
    return {
        "object": search.name,
        "belief": search.belief,
        "action": search.decision.action,
        "seconds": search.seconds,
        "tour": [
            {
                "viewpoint": view.name,
                "room": view.room,
                "pose": view.pose._asdict(),
                "shows": dict(view.shows),
                "opens": view.opens,
            }
            for view in search.tour
        ],
    }


def _show_trials(found: dict[str, Any]) -> None:
    """Print the durations as a table."""
    shorter = found["later searches are shorter than"]
    lines = [
        (
            name,
            _seconds(row["seconds"]),
            f"{row['right']:.0%}",
            _seconds(shorter[name]) if shorter.get(name) else "",
        )
        for name, row in found["strategies"].items()
    ]
    print_folded(("strategy", "seconds", "right", "later searches are shorter by"), lines)
    runs = found["runs"]
    cli.out.print(
        f"{found['trials']} objects, {runs} searches each; means with 95 % confidence intervals",
        style="dim",
    )


def _seconds(interval: dict[str, float]) -> str:
    return f"{interval['mean']:.1f} ± {interval['half_width']:.1f} s"


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
