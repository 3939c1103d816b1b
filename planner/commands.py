"""What the planner adds to the command line: `semmap route`, `robot` and `demo`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner import robot_command, route_command
from semmap import cli

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the planner's commands."""
    route_command.register(app)
    robot_command.register(app)
    app.command("demo")(demo_command)


def demo_command(
    world: Annotated[
        list[Path] | None, typer.Argument(help="World files; by default the office.")
    ] = None,
    start: Annotated[str | None, typer.Option("--from", help="Room to start in.")] = None,
    goal: Annotated[str | None, typer.Option("--to", help="Room to go to.")] = None,
    folder: Annotated[Path, typer.Option("--output", "-o", help="For maps and pictures.")] = Path(
        "out/demo"
    ),
) -> None:
    """Import a world, ask it, write its grids, find a route, and draw it all."""
    from planner.demo import run_demo  # slow to load, as all that draws

    run_demo(world or [], folder, start=start, goal=goal, say=cli.out.print)
