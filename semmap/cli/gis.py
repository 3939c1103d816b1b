"""The command `semmap gis project`."""

from __future__ import annotations

from pathlib import Path

import typer
from typer import Option

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of, group


@command_of("Map.write_qgis_project", path=None)
def _project(
    call: MethodCall,
    path: Path | None = Option(None, "--output", "-o", help="The project's file, .qgz."),
    store: bool = Option(
        False, "--store", help="Keep the project and default styles in the database, too."
    ),
) -> None:
    """Write a QGIS project: a floor plan of each storey whose layers edit the map.

    It has the database's address, but no password.
    """
    if path is None and not store:
        raise typer.BadParameter("give --output FILE.qgz, or --store, or both")
    if path is not None:
        print(call(path=path))
    if store:
        address = call.handle.store_qgis_project()
        print(address)
        if "@?" in address:
            folder = call.handle.engine.url.query["host"]
            cli.err.print(f"the database is on a socket: PGHOST={folder} qgis", style="dim")


gis_command = group(_project)
