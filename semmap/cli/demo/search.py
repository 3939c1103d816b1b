"""A search for the object of the demo: where to look first, and why (O'Neill, section 4.4.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from planner.readers.entity_lookup import find_entities
from planner.search.picture import search_picture
from planner.topology import OUTSIDE
from semmap.api.map import Map
from semmap.cli.demo.reader import DemoChoices
from semmap.draw.view import StoreyView

NAMED = 8
"""Number of viewpoints that the demo names."""


def search_demo(
    house: Map,
    choices: DemoChoices,
    storeys: Sequence[StoreyView],
    folder: Path,
    say: Callable[..., Any],
) -> list[Path]:
    """Say where to look for the chosen object first and why; draw all looks until it is found."""
    places = house.topology().places.items()
    rooms = [name for name, place in places if name != OUTSIDE and place.elevator is None]
    if choices.type is None or not rooms:
        say("   none: the map has no small object on a table, or no room")
        return []
    start = choices.start if choices.start in rooms else rooms[0]
    with house.snapshot() as seen:
        name = find_entities(seen, choices.type)[0].name
    try:
        found = house.search(name, start=start)
    except ValueError as error:
        say(f"   none: {error}")
        return []
    say(f"   {found.reason}")
    tour = list({view.name: view for view in found.tour}.values())
    names = ", ".join(v.name for v in tour[:NAMED])
    more = f" and {len(tour) - NAMED} more" if len(tour) > NAMED else ""
    say(f"   until it is seen: {names or 'no look'}{more}")
    picture, title = folder / "search.png", f"{house.name}: where to look for {name}, from {start}"
    for storey in storeys:
        if {v.room for v in tour[:1]} & {room.name for room in storey.rooms}:
            return [search_picture(storey, found.problem, found.decision, picture, title=title)]
    return []
