"""The command `semmap gis project`."""

from __future__ import annotations

from pathlib import Path

import typer
from typer import Option

from semmap import cli

gis = typer.Typer(no_args_is_help=True, help="The map in QGIS.")


@gis.callback()
def _group() -> None:
    """Keep `project` a command of the group, though it is the only one."""


@gis.command()
def project(
    path: Path | None = Option(None, "--output", "-o", help="The project's file, .qgz."),
    store: bool = Option(
        False, "--store", help="Keep the project and default styles in the database, too."
    ),
    map_name: cli.MapName = None,
) -> None:
    """Write a QGIS project: a floor plan of each storey whose layers edit the map.

    It has the database's address, but no password.
    """
    if path is None and not store:
        raise typer.BadParameter("give --output FILE.qgz, or --store, or both")
    with cli.chosen_map(map_name) as house:
        if path is not None:
            print(house.write_qgis_project(path))
        if store:
            address = house.store_qgis_project()
            print(address)
            if "@?" in address:
                note = "start QGIS with PGHOST=FOLDER, the host of: semmap db url"
                cli.err.print(f"the database is on a socket: {note}", style="dim")
