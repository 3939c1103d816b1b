"""The commands `semmap mcp`, `serve` and `view`: the map for programs and in the browser."""

from __future__ import annotations

import re
import secrets
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import typer
from typer import Option

from semmap import cli
from semmap.cli.chosen import chosen_map, open_database
from semmap.cli.options import MapName

if TYPE_CHECKING:
    from semmap.server.http_api import HttpApi


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
    rows: int = Option(50_000, min=1, help="The most rows of an answer of SPARQL."),
    origin: list[str] = Option(
        [], metavar="URL", help="Of pages of the web that may use it, such as https://maps.example."
    ),
) -> None:
    """Serve all maps over HTTP: operations, events, OGC API - Features, SPARQL, the viewer."""
    with _extra(), open_database() as database:
        from semmap.server.http_api import HttpApi
        from semmap.server.requests import read_tokens

        local = host in ("localhost", "127.0.0.1", "::1")
        if tokens is None and not local:
            raise typer.BadParameter(f"others reach {host}: give --tokens")
        for each in origin:
            if not re.fullmatch(r"https?://[^/*\s]+", each):
                raise typer.BadParameter(f"--origin {each}: give a scheme and a host, no path")
        known = {} if tokens is None else read_tokens(tokens)
        limits: Any = {"seconds": seconds, "rows": rows}
        api = HttpApi(database, known, local=local, origins=origin, **limits)

        def say(port: int) -> None:
            cli.err.print(f"http://{host}:{port}/maps; the operations: /openapi.json", style="dim")

        _run(api, host, port, say)


def view_command(
    map_name: MapName = None,
    port: int = Option(8891, min=0, max=65535, help="Where to listen, on this machine."),
    browser: bool = Option(True, help="Open the page."),
    write: bool = Option(False, "--write", help="Who has the address may change the map."),
) -> None:
    """Show the map in 3D in the browser, with its changes as they come."""
    with _extra("viewer"), chosen_map(map_name) as chosen:
        from semmap.server.http_api import HttpApi
        from semmap.server.viewer_files import viewer_is_built

        if not viewer_is_built():
            raise typer.BadParameter("the page is not built: run scripts/setup viewer")
        tokens = {secrets.token_urlsafe(24): "semmap_admin"} if write else {}

        def show(port: int) -> None:
            url = f"http://127.0.0.1:{port}/view/?map={quote(chosen.name, safe='')}"
            url += "".join(f"#token={token}" for token in tokens)
            print(url, flush=True)
            cli.err.print("Ctrl-C stops", style="dim")
            if browser:
                webbrowser.open(url)

        _run(HttpApi(chosen.database, tokens), "127.0.0.1", port, show)


def _run(api: HttpApi, host: str, port: int, begun: Callable[[int], object]) -> None:
    """Answer requests until the program is interrupted; `begun` has the port when it listens."""
    from semmap.server.http_server import HttpServer

    try:
        with suppress(KeyboardInterrupt):
            HttpServer(api, host, port, begun).run()
    except SystemExit:
        raise typer.BadParameter(
            f"{host}:{port} cannot be used: choose another port or host"
        ) from None


@contextmanager
def _extra(name: str = "server") -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        raise typer.BadParameter(
            f"{error.name} is not installed: pip install 'semmap[{name}]'"
        ) from None
