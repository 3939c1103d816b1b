"""The rows of the table of each kind: storey, elevator, room, connector, region."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import psycopg

from semmap.ingest.world import (
    OUTSIDE,
    ConnectorDetail,
    Entry,
    PlaceDetail,
    StoreyDetail,
    World,
    WorldError,
)


def store_details(
    cursor: psycopg.Cursor[Any], entries: Sequence[Entry], ids: dict[str, int], world: World
) -> None:
    """Store the rows of each kind's table, elevators before cabins, rooms before doors."""
    for kind in ("storey", "elevator", "room", "connector", "region"):
        for e in (e for e in entries if e.kind == kind):
            columns = _detail(e, ids, world)
            names, marks = ", ".join(columns), ", ".join(["%s"] * (1 + len(columns)))
            updates = ", ".join(f"{name} = excluded.{name}" for name in columns)
            action = f"UPDATE SET {updates}" if columns else "NOTHING"
            statement = (
                f"INSERT INTO {kind} (entity_id{', ' if columns else ''}{names}) VALUES ({marks}) "
                f"ON CONFLICT (entity_id) DO {action}"
            )
            cursor.execute(statement.encode(), [ids[e.name], *columns.values()])


def _detail(entry: Entry, ids: dict[str, int], world: World) -> dict[str, Any]:
    match entry.detail:
        case StoreyDetail() as level:
            return {"elevation": level.elevation, "height": level.height}
        case PlaceDetail() as place:
            cabin_of = id_of(ids, place.elevator, entry, world) if place.elevator else None
            return {"floor": place.floor, "ceiling": place.ceiling, "elevator_id": cabin_of}
        case ConnectorDetail() as c:
            a, b = c.places
            same = ("direction", "state", "behaviour", "width", "height", "step")
            return {
                "form": c.type,
                "place_a": id_of(ids, a, entry, world),
                "place_b": None if b == OUTSIDE else id_of(ids, b, entry, world),
                "pose_a": c.poses[0].row,
                "pose_b": c.poses[1].row,
                "permissions": list(c.permissions),
                **{name: getattr(c, name) for name in same},
            }
    if entry.kind == "connector":
        problem = "does not join two places"
        raise WorldError(world.source, entry.name, problem, "Name the places it joins.")
    return {}


def id_of(ids: dict[str, int], name: str, entry: Entry, world: World) -> int:
    """Return the id of an entity that an entry names, in the file or in the map."""
    if name not in ids:
        problem = f"names {name}, which is neither in the file nor in the map"
        fix = "Import what it names first, or correct the name."
        raise WorldError(world.source, entry.name, problem, fix)
    return ids[name]
