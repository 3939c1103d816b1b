"""`semmap demo`: the whole chain, from world files to pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from semmap.cli.options import Parts, State, Urdf


def demo_command(
    world: Annotated[list[Path], typer.Argument(help="World files, or folders of them.")],
    urdf: Urdf,
    start: Annotated[str | None, typer.Option("--from", help="Room to start in.")] = None,
    goal: Annotated[str | None, typer.Option("--to", help="Room to go to.")] = None,
    state: State = None,
    parts: Parts = None,
    model_path: Annotated[
        list[Path] | None,
        typer.Option("--model-path", help="Folder of SDF models, searched first; repeatable."),
    ] = None,
    folder: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for maps and pictures.")
    ] = Path("out/demo"),
) -> None:
    """Import a world, query it, write its grids, find a route, drive a task, and draw it all."""
    from semmap import cli
    from semmap.cli.demo.demo_robot import DemoRobot
    from semmap.cli.demo.run import run_demo

    run_demo(
        world,
        folder,
        DemoRobot(urdf, state, parts),
        start=start,
        goal=goal,
        model_path=model_path or (),
        say=cli.out.print,
    )
