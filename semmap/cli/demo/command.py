"""`semmap demo`: the whole chain, from world files to pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option


def demo_command(
    world: Annotated[list[Path], Argument(help="World files, or folders of them.")],
    urdf: Path = Option(..., "--robot", help="The robot's URDF."),
    start: str | None = Option(None, "--from", help="Room to start in."),
    goal: str | None = Option(None, "--to", help="Room to go to."),
    state: str | None = Option(
        None, help="Joint positions as JSON, a file, or a state of its SRDF; by default found."
    ),
    parts: Path | None = Option(None, help="YAML that groups links into parts; else found."),
    model_path: list[Path] | None = Option(
        None, help="Folder of SDF models, searched first; repeatable."
    ),
    folder: Path = Option(Path("out/demo"), "--output", "-o", help="Folder for maps and pictures."),
) -> None:
    """Import a world, query it, write its grids, find a route, drive a task, and draw it all."""
    from semmap import cli
    from semmap.cli.demo.costmaps import DemoRobot
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
