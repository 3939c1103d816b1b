"""Which objects have no geometry, an assumed size or no storey: for people and for JSON."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from semmap.geometry.levels import APART, are_floors, in_metres, stacked, standing_levels
from semmap.query.snapshot import Snapshot
from semmap.query.storey_scene import SceneEntity, StoreyScene

SHOWN = 5
"""Names in a note; the lists have all of them."""

_NOTES = {
    "no_geometry": "no geometry: treated as free floor",
    "assumed_sizes": "no geometry: the typical size of the type is assumed, an own estimate unless "
    "sizes.ttl states another source",
}


def geometry_lists(entities: Iterable[SceneEntity]) -> dict[str, list[str]]:
    """Return the names of objects without geometry, and of those with an assumed size."""
    entities = [*entities]
    return {
        "no_geometry": [entity.name for entity in entities if entity.lacks_geometry],
        "assumed_sizes": [entity.name for entity in entities if entity.assumed],
    }


def geometry_notes(entities: Iterable[SceneEntity]) -> list[str]:
    """Return a sentence about objects without geometry and one about assumed sizes, if any.

    >>> geometry_notes([SceneEntity(1, "bed1", "object"), SceneEntity(2, "bed2", "object")])
    ['2 objects with no geometry: treated as free floor: bed1, bed2']
    """
    lists = geometry_lists(entities)
    return [names_note(names, key) for key, names in lists.items() if names]


def level_notes(scene: StoreyScene) -> list[str]:
    """Return a sentence if things, or rooms above others, are as far above a floor as a storey."""
    return [*_stacked_rooms(scene), *_high_things(scene)]


def _stacked_rooms(scene: StoreyScene) -> list[str]:
    rooms = [
        (e.footprint, e.floor)
        for e in scene.inventory
        if e.kind == "room" and e.footprint is not None and e.floor is not None
    ]
    found = stacked([outline for outline, _ in rooms], [floor for _, floor in rooms])
    if not found:
        return []
    levels = sorted({round(rooms[n][1], 2) for n in found})
    return [
        f"rooms lie one above the other at {in_metres(levels)} on storey {scene.storey}, in one "
        "grid: add their storeys (map.add_storey, or kind storey in a GeoJSON file)"
    ]


def _high_things(scene: StoreyScene) -> list[str]:
    things = [
        (e.bounds, e.heights)
        for e in scene.inventory
        if e.kind == "object" and e.bounds is not None and e.heights is not None
    ]
    boxes = np.array(
        [((x0, y0, low), (x1, y1, high)) for (x0, y0, x1, y1), (low, high) in things]
    ).reshape(-1, 2, 3)
    floors = [scene.elevation, *(area.floor for area in scene.floors)]
    tops = [e.ceiling for e in scene.inventory if e.kind == "room" and e.ceiling is not None]
    lowest = max(floors) + APART if not tops else max(*floors, *tops)
    levels = [z for z in standing_levels(boxes, are_floors(boxes)) if z >= lowest]
    if not levels:
        return []
    return [
        f"things stand at {in_metres(levels)}, far above the floors of storey {scene.storey}: if "
        "these are storeys, add them (map.add_storey, or kind storey in a GeoJSON file)"
    ]


def names_note(names: Sequence[str], key: str = "no_geometry") -> str:
    """Return a sentence about objects without geometry; `key` is one of `_NOTES`."""
    objects = f"{len(names)} object{'s' if len(names) > 1 else ''}"
    return f"{objects} with {_NOTES[key]}: {listed(names)}"


def listed(names: Sequence[str]) -> str:
    """Return the first `SHOWN` names, and how many more there are."""
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def read_names_without_geometry(
    seen: Snapshot, places: Sequence[str] | None = None, *, assume_sizes: bool = False
) -> list[str]:
    """Return the names of the map's objects without geometry, in order.

    `places` are rooms that hold them, directly or not; with `assume_sizes`, only those of types
    without a typical size.
    """
    values = {"places": None if places is None else [*places], "assume_sizes": assume_sizes}
    return [name for (name,) in seen.session.execute(_NAMES, values).fetchall()]


_NAMES = """
WITH RECURSIVE held (id) AS (
    SELECT id FROM entity WHERE map_id = current_map() AND kind = 'room' AND name = ANY(%(places)s)
    UNION SELECT p.entity_id FROM held JOIN placement p ON p.holder_id = held.id
)
SELECT e.name FROM entity e WHERE e.map_id = current_map() AND e.kind = 'object'
AND (%(places)s::text[] IS NULL OR e.id IN (SELECT id FROM held))
AND NOT (%(assume_sizes)s AND EXISTS (
    SELECT FROM type_closure c JOIN semantic_type t ON t.name = c.super
    WHERE c.sub = e.type AND t.typical_size IS NOT NULL))
AND NOT EXISTS (SELECT FROM entity_model em JOIN model m ON m.id = em.model_id
                WHERE em.entity_id = e.id AND (m.triangles > 0 OR m.kind = 'cloud'))
ORDER BY e.name
"""
