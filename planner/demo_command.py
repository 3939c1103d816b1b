"""`semmap demo`: the main job, on the office or a world of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from semmap import cli

__all__ = ["demo_command"]


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
