"""The command `semmap mcp`: the map as tools for programs that speak for people."""

from __future__ import annotations

from contextlib import ExitStack

import typer
from typer import Option

from semmap.cli.chosen import chosen_map
from semmap.cli.options import MapName


def mcp_command(
    map_name: MapName = None,
    write: bool = Option(False, "--write", help="Also offer tools that change the map."),
) -> None:
    """Serve the map as tools of the Model Context Protocol, on standard input and output."""
    try:
        import anyio

        from semmap.server.mcp_server import ToolServer, serve_stdio
        from semmap.server.reading import reading_database
    except ModuleNotFoundError as error:
        raise typer.BadParameter(
            f"{error.name} is not installed: pip install 'semmap[server]'"
        ) from None
    with ExitStack() as stack:
        chosen = stack.enter_context(chosen_map(map_name))
        reading = stack.enter_context(reading_database(chosen.database))
        tools = ToolServer(reading.map(chosen.name), chosen if write else None)
        anyio.run(serve_stdio, tools)
