"""The command `semmap export`."""

from __future__ import annotations

import json

from semmap import cli
from semmap.cli.made import MethodCall, made
from semmap.cli.options import Json


@made("Map.export")
def export_command(call: MethodCall, json_: Json = False) -> None:
    """Write the map to a file of another program; most can be imported again."""
    written = str(call())
    if json_:
        print(json.dumps(written))
    else:
        cli.out.print(written)
