"""The commands `semmap rooms ...`."""

from __future__ import annotations

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of, group, printed
from semmap.cli.options import Json
from semmap.cli.output import show_table


@command_of("Map.find_rooms")
def _find(call: MethodCall, json_: Json = False) -> None:
    """Find the rooms and doorways that the walls of the map enclose.

    Rooms and connectors of the map stay as they are. Types follow from the furniture; each has a
    confidence from 0 to 1. Once added, they can be renamed, redrawn and given other types.
    """
    found = call()
    for each in found:
        if each.problem:
            cli.err.print(f"left out: {each.problem}", style="yellow")
        for note in each.notes:
            cli.err.print(f"note: {note}", style="dim")
    show_table([row for each in found for row in each.table()], json_)
    listed = not json_ and not call.values["add"]
    if listed and any(each.rooms or each.doorways for each in found):
        cli.err.print("to put them into the map: semmap rooms find --add", style="dim")


rooms_command = group(
    _find,
    printed("Map.merge_rooms", "", others="NAME..."),
    printed("Map.split_room", "", line="--line X,Y"),
)
