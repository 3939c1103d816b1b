"""The rows of the table of each kind: storey, elevator, room, connector, region."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import psycopg
from psycopg import sql

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
            names = sql.SQL(", ").join(map(sql.Identifier, columns))
            updates = sql.SQL(", ").join(
                sql.SQL("{0} = excluded.{0}").format(sql.Identifier(c))
                for c in columns
                if c != "entity_id"
            )
            action = sql.SQL("UPDATE SET ") + updates if len(columns) > 1 else sql.SQL("NOTHING")
            cursor.execute(
                sql.SQL("INSERT INTO {} ({}) VALUES ({}) ON CONFLICT (entity_id) DO {}").format(
                    sql.Identifier(kind),
                    names,
                    sql.SQL(", ").join(sql.Placeholder() * len(columns)),
                    action,
                ),
                list(columns.values()),
            )


def _detail(entry: Entry, ids: dict[str, int], world: World) -> dict[str, Any]:
    row: dict[str, Any] = {"entity_id": ids[entry.name]}
    match entry.detail:
        case StoreyDetail() as level:
            row |= {"elevation": level.elevation, "height": level.height}
        case PlaceDetail() as place:
            cabin_of = id_of(ids, place.elevator, entry, world) if place.elevator else None
            row |= {"floor": place.floor, "ceiling": place.ceiling, "elevator_id": cabin_of}
        case ConnectorDetail() as c:
            a, b = c.places
            row |= {
                "form": c.type,
                "place_a": id_of(ids, a, entry, world),
                "place_b": None if b == OUTSIDE else id_of(ids, b, entry, world),
                "pose_a": c.poses[0].row,
                "pose_b": c.poses[1].row,
                "direction": c.direction,
                "state": c.state,
                "behaviour": c.behaviour,
                "width": c.width,
                "height": c.height,
                "step": c.step,
                "permissions": list(c.permissions),
            }
        case None if entry.kind == "connector":
            raise WorldError(
                world.source, entry.name, "does not join two places", "Name the places it joins."
            )
        case _:
            pass
    return row


def id_of(ids: dict[str, int], name: str, entry: Entry, world: World) -> int:
    """Return the id of an entity that an entry names, in the file or in the map."""
    if name not in ids:
        raise WorldError(
            world.source,
            entry.name,
            f"names {name}, which is neither in the file nor in the map",
            "Import what it names first, or correct the name.",
        )
    return ids[name]
