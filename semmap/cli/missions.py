"""`semmap run` and `semmap missions`: goals that robots pursue."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from semmap import cli
from semmap.cli import mission_options as options
from semmap.cli.grid_options import AssumeSizes


def run_command(
    goal: Annotated[
        str | None, typer.Argument(help="on(muffin, desk1) and in(robot, kitchen), ...")
    ] = None,
    start: options.Start = None,
    robot: options.Agent = "robot",
    robot_class: options.RobotName = None,
    simulate: Annotated[bool, typer.Option("--simulate", help="Simulate the robot.")] = False,
    speed: options.Speed = 20.0,
    fail: options.Fail = None,
    seed: options.Seed = 0,
    put: options.Put = None,
    gripper: Annotated[
        str | None,
        typer.Option(help="Gripper of the robot; by default its own or the preferred one."),
    ] = None,
    world: options.WorldFile = None,
    apply: options.Apply = False,
    try_grasps: Annotated[
        bool | None,
        typer.Option(
            "--try-grasps/--assume-grasps",
            help="Try each grasp in simulation, by default where MuJoCo is installed; or assume "
            "that it succeeds and learn nothing.",
        ),
    ] = None,
    assume_sizes: AssumeSizes = False,
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

    from semmap.cli.mission_output import say, show_event, show_mission

    with cli.chosen_map(map_name) as house:
        ended = house.run(
            goal,
            start=start,
            robot=robot_class,
            agent=robot,
            speed=speed,
            fail=fail or (),
            seed=seed,
            put=put or (),
            gripper=gripper,
            world=world,
            apply=apply,
            domain=domain_file,
            try_grasps=try_grasps,
            assume_sizes=assume_sizes,
            resume=resume,
            mission=mission,
            on_event=None if json_ else show_event,
            say=None if json_ else say,
        )
    show_mission(ended, json_)


def missions_command(
    mission: Annotated[int | None, typer.Argument(help="Show the steps of this mission.")] = None,
    cancel: Annotated[
        int | None, typer.Option(help="Cancel this mission; its robot stops.")
    ] = None,
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
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in rows[0] if rows else ():
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*(_readable(v) for v in row.values()))
    cli.out.print(table if rows else "none")


def _readable(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return f"{value:%Y-%m-%d %H:%M:%S}" if hasattr(value, "strftime") else str(value)
