"""The command `semmap export`."""

from __future__ import annotations

import json

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of
from semmap.cli.options import Json


@command_of("Map.export")
def export_command(call: MethodCall, json_: Json = False) -> None:
    """Write the map to a file of another program; most can be imported again."""
    written = str(call())
    if json_:
        print(json.dumps(written))
    else:
        cli.out.print(written)
