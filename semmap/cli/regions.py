"""The commands `semmap regions find`, `draw` and `ls`."""

from __future__ import annotations

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of, group, printed
from semmap.cli.options import Json
from semmap.cli.output import show_table

COLUMNS = ("name", "type", "origin", "of", "holder", "area", "low", "high", "faces")


@command_of("Map.find_regions", names="[NAME]...")
def _find(call: MethodCall, json_: Json = False) -> None:
    found = call()
    for reason in found.problems:
        cli.err.print(f"left out: {reason}", style="yellow")
    show_table(found, json_, COLUMNS)


@command_of("Map.draw_region", properties="--property KEY=VALUE")
def _draw(call: MethodCall, json_: Json = False) -> None:
    show_table([call()], json_, COLUMNS)


regions_command = group(
    _find,
    _draw,
    printed("Map.list_regions", COLUMNS),
)
