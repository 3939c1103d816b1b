"""Options that many commands have."""

from __future__ import annotations

from typing import Annotated

import typer

MapName = Annotated[
    str | None,
    typer.Option("--map", envvar="SEMMAP_MAP", help="The map; not needed where there is one only."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
