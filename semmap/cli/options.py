"""Options that many commands have."""

from __future__ import annotations

from typing import Annotated

import typer

__all__ = ["Json", "MapName"]

MapName = Annotated[
    str | None,
    typer.Option("--map", envvar="SEMMAP_MAP", help="The map; not needed where there is one only."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
