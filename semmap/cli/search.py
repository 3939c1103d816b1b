"""`semmap search`: where to look for an object, and a mission that looks for it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semmap import cli
from semmap.cli import mission_options as options
from semmap.cli.place_progress import place_progress

if TYPE_CHECKING:
    from semmap.api.map_results import ObjectSearch


def search_command(
    name: Annotated[str, typer.Argument(help="Name of the object.")],
    start: options.Start = None,
    robot: options.Agent = "robot",
    robot_class: options.RobotName = None,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Let a simulated robot search.")
    ] = False,
    put: options.Put = None,
    wrong: Annotated[
        float, typer.Option(help="Seconds that a wrong answer costs; with more, it looks longer.")
    ] = 3600.0,
    hit: Annotated[float, typer.Option(help="P(seen | the object is in view).")] = 0.9,
    false_alarm: Annotated[float, typer.Option(help="P(seen | it is not there).")] = 0.02,
    look: Annotated[float, typer.Option(help="Seconds of a look.")] = 3.0,
    camera_height: Annotated[float, typer.Option(help="Of the camera, metres.")] = 1.2,
    range_: Annotated[
        float, typer.Option("--range", help="Metres within which the robot recognises objects.")
    ] = 3.5,
    trials: Annotated[
        int, typer.Option(help="Compare so many random searches with other strategies.")
    ] = 0,
    pomdp: Annotated[
        Path | None, typer.Option(help="Write the search as a .pomdp file for other solvers.")
    ] = None,
    speed: options.Speed = 20.0,
    fail: options.Fail = None,
    seed: options.Seed = 0,
    world: options.WorldFile = None,
    apply: options.Apply = False,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Search for an object: say where to look first and why, or let a simulated robot do it."""
    from planner.search.problem_builder import Detector
    from planner.search.viewpoints import Sight
    from semmap.cli.mission_output import say, show_event, show_mission

    try:
        sight = Sight(height=camera_height, furthest=range_)
        detector = Detector(hit, false_alarm, look, wrong)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    seeing: Any = {"start": start, "robot": robot_class, "sight": sight, "detector": detector}
    with cli.chosen_map(map_name) as house:
        if simulate:
            ended = house.run(
                f'found("{name}")',
                agent=robot,
                speed=speed,
                fail=fail or (),
                seed=seed,
                world=world,
                apply=apply,
                put=put or (),
                on_event=None if json_ else show_event,
                say=None if json_ else say,
                **seeing,
            )
            show_mission(ended, json_)
            return
        with place_progress(quiet=json_) as progress:
            search = house.search(name, progress=progress, **seeing)
    if pomdp is not None:
        search.write_pomdp(pomdp)
    if trials:
        found = search.compare(trials, seed)
        print(json.dumps(found)) if json_ else _show_trials(found)
    elif json_:
        print(json.dumps(_as_json(search)))
    else:
        cli.out.print(search.reason)
        _show_tour(search)


def _show_tour(search: ObjectSearch) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("look from", "x", "y", "shows"):
        table.add_column(column, overflow="fold")
    for view in search.tour:
        shows = ", ".join(f"{place} {share:.0%}" for place, share in view.shows[:6])
        opens = f"open {view.opens}: " if view.opens else ""
        table.add_row(view.name, f"{view.pose.x:.2f}", f"{view.pose.y:.2f}", opens + shows)
    if search.tour:
        cli.out.print(table)


def _as_json(search: ObjectSearch) -> dict[str, Any]:
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
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("strategy", "seconds", "right", "later searches are shorter by"):
        table.add_column(column)
    shorter = found["later searches are shorter than"]
    for name, row in found["strategies"].items():
        by = shorter.get(name)
        table.add_row(
            name,
            _seconds(row["seconds"]),
            f"{row['right']:.0%}",
            "" if by is None else _seconds(by),
        )
    cli.out.print(table)
    runs = found["runs"]
    cli.out.print(
        f"{found['trials']} objects, {runs} searches each; means with 95 % confidence intervals",
        style="dim",
    )


def _seconds(interval: dict[str, float]) -> str:
    return f"{interval['mean']:.1f} ± {interval['half_width']:.1f} s"
