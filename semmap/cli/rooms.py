"""The commands `semmap rooms ...`."""

from __future__ import annotations

import typer
from typer import Argument, Option

from semmap import cli
from semmap.cli.texts import numbers

rooms = typer.Typer(no_args_is_help=True, help="Rooms and doorways: found in walls, and edited.")


@rooms.command()
def find(
    storey: str | None = Option(None, help="Only this one."),
    add: bool = Option(False, "--add", help="Put them into the map; else they are listed only."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Find the rooms and doorways that the walls of the map enclose.

    Rooms and connectors of the map stay as they are. Types follow from the furniture; each has a
    confidence from 0 to 1. Once added, they can be renamed, redrawn and given other types.
    """
    with cli.chosen_map(map_name) as house:
        found = house.find_rooms(storey=storey, add=add)
    for each in found:
        if each.problem:
            cli.err.print(f"left out: {each.problem}", style="yellow")
    cli.show_table([row for each in found for row in each.table()], json_)
    if not json_ and not add and any(each.rooms or each.doorways for each in found):
        cli.err.print("to put them into the map: semmap rooms find --add", style="dim")


@rooms.command()
def merge(
    name: str = Argument(help="The room that stays."),
    others: list[str] = Argument(help="Rooms beside it, which become parts of it."),
    map_name: cli.MapName = None,
) -> None:
    """Make rooms that lie side by side one room, with the doors and contents of all."""
    with cli.chosen_map(map_name) as house:
        house.merge_rooms(name, *others)


@rooms.command()
def split(
    name: str = Argument(help="The room; it keeps the larger part."),
    new: str = Argument(help="The name of the other part."),
    line: list[str] = Argument(metavar="X,Y X,Y...", help="Points from wall to wall, metres."),
    map_name: cli.MapName = None,
) -> None:
    """Cut a room in two along a line, such as: semmap rooms split hall entry 2,-1 2,6"""
    with cli.chosen_map(map_name) as house:
        house.split_room(name, [numbers(point, "a point", 2) for point in line], new)
