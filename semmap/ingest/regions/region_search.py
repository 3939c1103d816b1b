"""Regions of many entities at once, found in their geometry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from sqlalchemy.exc import DBAPIError

from semmap.found_rows import FoundRows
from semmap.ingest.regions.extraction import (
    find_observation_area,
    find_support_surfaces,
    find_walkable_floor,
)
from semmap.query import entity_query
from semmap.query.snapshot import Snapshot

SORTS: dict[str, tuple[str, Callable[..., int | list[int]]]] = {
    "surfaces": ("object", find_support_surfaces),
    "floor": ("room", find_walkable_floor),
    "observation": ("object", find_observation_area),
}
"""The kind of the entities that have regions of a sort, and what finds them."""


def find_regions(
    seen: Snapshot,
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
    if sort not in SORTS:
        raise ValueError(f"the sort of regions {sort} is not one of {', '.join(SORTS)}")
    kind, seek = SORTS[sort]
    found: list[int] = []
    problems: list[str] = []

    def search(entity: int) -> None:
        made = seek(seen.connection, entity, **options)
        found.extend(made if isinstance(made, list) else [made])

    for name in names:
        search(entity_query.entity_id(seen.session, name))
    for row in entity_query.find(seen, type=type) if type is not None else []:
        if row["kind"] != kind or row["x"] is None:  # of another kind, or not placed
            continue
        try:
            with seen.connection.begin_nested():
                search(row["id"])
        except (ValueError, DBAPIError) as error:  # some of many may have none
            problems.append(str(error.orig if isinstance(error, DBAPIError) else error))
    return FoundRows(entity_query.list_regions(seen, found), problems)
