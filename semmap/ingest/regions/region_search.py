"""Regions of many entities at once, found in their geometry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import psycopg
from sqlalchemy import Connection
from sqlalchemy.exc import DBAPIError

from semmap.database.maps import driver_of
from semmap.found_rows import FoundRows
from semmap.ingest.regions.extraction import (
    find_observation_area,
    find_support_surfaces,
    find_walkable_floor,
)
from semmap.query import entity_query

SORTS: dict[str, str] = {"surfaces": "object", "floor": "room", "observation": "object"}
"""The kind of the entities that have regions of a sort."""


def find_regions(
    connection: Connection,
    sort: str,
    names: Sequence[str] = (),
    type: str | None = None,
    **options: Any,
) -> FoundRows:
    """Find regions in the geometry of rooms or objects of these names, and of a type; store them.

    `sort` is one of `SORTS`, `options` are of what finds them. The rows are those of
    `list_regions`; `problems` has the reasons for those of the type without any. Errors name an
    unknown entity, type or sort, and an entity of `names` without such a region.
    """
    seek: dict[str, Callable[[Connection, int], int | list[int]]] = {
        "surfaces": find_support_surfaces,
        "floor": partial(find_walkable_floor, **options),
        "observation": partial(find_observation_area, **options),
    }
    if sort not in seek:
        raise ValueError(f"the sort of regions {sort} is not one of {', '.join(seek)}")
    session = driver_of(connection)
    found: list[int] = []
    problems: list[str] = []
    for name in names:
        made = seek[sort](connection, entity_query.entity_id(session, name))
        found += made if isinstance(made, list) else [made]
    for entity in _of_type(session, type, SORTS[sort]) if type is not None else []:
        try:
            with connection.begin_nested():
                made = seek[sort](connection, entity)
        except (ValueError, DBAPIError) as error:  # some of many may have none
            problems.append(str(error.orig if isinstance(error, DBAPIError) else error))
            continue
        found += made if isinstance(made, list) else [made]
    return FoundRows(entity_query.list_regions(session, found), problems)


def _of_type(session: psycopg.Connection[Any], type: str, kind: str) -> list[int]:
    """The ids of the placed entities of a kind and type, by name."""
    names = [row["name"] for row in entity_query.find(session, type=type) if row["kind"] == kind]
    rows = session.execute(
        "SELECT e.id FROM entity e JOIN world w ON w.entity_id = e.id "
        "WHERE e.map_id = current_map() AND e.name = ANY (%s) ORDER BY e.name",
        (names,),
    )
    return [row[0] for row in rows.fetchall()]
