"""The commands `semmap regions find`, `draw` and `ls`."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any

import typer
from typer import Argument, Option

from semmap import cli
from semmap.cli.texts import key_values, numbers

regions = typer.Typer(
    no_args_is_help=True, help="Parts of rooms and objects: drawn, or found in the geometry."
)

COLUMNS = ["name", "type", "origin", "of", "holder", "area", "low", "high", "faces"]


class Sort(StrEnum):
    """Kinds of regions that geometry shows."""

    surfaces = "surfaces"
    floor = "floor"
    observation = "observation"


@regions.command()
def find(
    sort: Sort = Argument(help="Of objects: surfaces, observation; of rooms: floor."),
    names: list[str] | None = Argument(None, metavar="NAME..."),
    type_: str | None = Option(None, "--type", help="All of this type: table, kitchen, room."),
    near: float = Option(0.5, help="observation: least distance from the object, metres."),
    far: float = Option(1.2, help="observation: largest distance from the object, metres."),
    headroom: float = Option(2.0, help="floor: free height above it, metres."),
    max_step: float = Option(0.03, help="floor: highest step up or down, metres."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Find regions in the geometry of rooms and objects.

    surfaces: where other objects can stand; floor: the walkable floor of a room as it is now;
    observation: the ring around an object from which to observe it.
    """
    if not names and type_ is None:
        raise typer.BadParameter("name rooms or objects, or give --type")
    sizes = {"near": near, "far": far, "headroom": headroom, "max_step": max_step}
    with cli.chosen_map(map_name) as house:
        found = house.find_regions(sort.value, names or (), type=type_, **sizes)
    for reason in found.problems:
        cli.err.print(f"left out: {reason}", style="yellow")
    cli.show_table(found, json_, COLUMNS)


@regions.command()
def draw(
    name: str,
    polygon: str | None = Option(None, help='Corners "x,y x,y x,y ..." in the map, metres.'),
    box: str | None = Option(None, help="X0,Y0,Z0,X1,Y1,Z1 in the map's frame."),
    type_: str = Option("region", "--type", help="Such as blocked_region."),
    holder: str | None = Option(None, help="Room or object that holds it and moves it."),
    where: list[str] | None = Option(None, "--property", help="KEY=VALUE; repeatable."),
    since: datetime | None = Option(None, help="It is valid from then on."),
    until: datetime | None = Option(None, help="It is valid until then."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Draw or redraw a region: a polygon from floor to ceiling, or a box."""
    outline = None if polygon is None else _corners(polygon)
    asked: Any = {"box": None if box is None else numbers(box, "--box", 6), "type": type_}
    asked |= {"holder": holder, "properties": key_values(where, "--property")}
    with cli.chosen_map(map_name) as house:
        region = house.draw_region(name, outline, since=since, until=until, **asked)
    cli.show_table([region], json_, COLUMNS)


@regions.command()
def ls(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the regions, with their owners and origins."""
    with cli.chosen_map(map_name) as house:
        cli.show_table(house.list_regions(), json_, COLUMNS)


def _corners(given: str) -> list[tuple[float, ...]]:
    """The corners of ``x,y x,y x,y ...``."""
    try:
        corners = [tuple(float(v) for v in corner.split(",")) for corner in given.split()]
    except ValueError:
        corners = []
    if len(corners) < 3 or any(len(corner) != 2 for corner in corners):
        raise ValueError(f'--polygon takes three corners or more, "x,y x,y x,y", not {given}')
    return corners
