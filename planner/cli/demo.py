"""`semmap demo`: the whole chain, from world files to pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["demo_command"]


def demo_command(
    world: Annotated[
        list[Path] | None, typer.Argument(help="World files; by default the example office.")
    ] = None,
    start: Annotated[str | None, typer.Option("--from", help="Room to start in.")] = None,
    goal: Annotated[str | None, typer.Option("--to", help="Room to go to.")] = None,
    folder: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for maps and pictures.")
    ] = Path("out/demo"),
) -> None:
    """Import a world, query it, write its grids, find a route, and draw all of it."""
    from planner.demo.run import run_demo
    from semmap import cli

    run_demo(world or [], folder, start=start, goal=goal, say=cli.out.print)
