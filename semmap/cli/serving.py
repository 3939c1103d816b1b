"""The commands `semmap mcp` and `semmap serve`: the map for programs of others."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import typer
from typer import Option

from semmap import cli
from semmap.cli.chosen import chosen_map, open_database
from semmap.cli.options import MapName


def mcp_command(
    map_name: MapName = None,
    write: bool = Option(False, "--write", help="Also offer tools that change the map."),
) -> None:
    """Serve the map as tools of the Model Context Protocol, on standard input and output."""
    with _extra(), ExitStack() as stack:
        import anyio

        from semmap.server.handles import Handles
        from semmap.server.mcp_server import ToolServer, serve_stdio

        chosen = stack.enter_context(chosen_map(map_name))
        reading = stack.enter_context(Handles(chosen.database).open(None))
        tools = ToolServer(reading.map(chosen.name), chosen if write else None)
        anyio.run(serve_stdio, tools)


def serve_command(
    host: str = Option("127.0.0.1", help="Where to listen."),
    port: int = Option(8890, min=0, max=65535, help="Where to listen."),
    tokens: Path | None = Option(
        None, help="A token and its database role in each line; without it, nobody may write."
    ),
    seconds: float = Option(60, min=0.1, max=86_400, help="Stop a statement after this time."),
    rows: int = Option(1_000_000, min=1, help="The most rows of an answer of SPARQL."),
) -> None:
    """Serve all maps over HTTP: operations, events, OGC API - Features, SPARQL."""
    with _extra(), open_database() as database:
        import uvicorn

        from semmap.server.http_api import HttpApi
        from semmap.server.requests import read_tokens

        local = host in ("localhost", "127.0.0.1", "::1")
        if tokens is None and not local:
            raise typer.BadParameter(f"others reach {host}: give --tokens")
        known = {} if tokens is None else read_tokens(tokens)
        api = HttpApi(database, known, local=local, seconds=seconds, rows=rows)
        cli.err.print(f"http://{host}:{port}/maps; the operations: /openapi.json", style="dim")
        with suppress(KeyboardInterrupt):
            uvicorn.run(
                api.app, host=host, port=port, log_level="warning", timeout_graceful_shutdown=5
            )


@contextmanager
def _extra() -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        raise typer.BadParameter(
            f"{error.name} is not installed: pip install 'semmap[server]'"
        ) from None
