"""Which objects have no geometry: as sentences for people, and as lists for JSON."""

from __future__ import annotations

from collections.abc import Iterable

from semmap.query.storey_scene import SceneEntity

__all__ = ["geometry_lists", "geometry_notes"]

SHOWN = 5
"""Names in a note; the lists have all of them."""


def geometry_lists(entities: Iterable[SceneEntity]) -> dict[str, list[str]]:
    """Return the names of the objects without geometry, as ``no_geometry``.

    Parameters
    ----------
    entities : iterable of SceneEntity
    """
    return {"no_geometry": [entity.name for entity in entities if entity.lacks_geometry]}


def geometry_notes(entities: Iterable[SceneEntity]) -> list[str]:
    """Return a sentence about the objects without geometry; an empty list if all have some.

    Parameters
    ----------
    entities : iterable of SceneEntity

    Examples
    --------
    >>> geometry_notes([SceneEntity(1, "bed1", "object"), SceneEntity(2, "bed2", "object")])
    ['2 objects with no geometry: treated as free floor: bed1, bed2']
    """
    names = geometry_lists(entities)["no_geometry"]
    if not names:
        return []
    count = f"{len(names)} object{'s' if len(names) > 1 else ''}"
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    listed = ", ".join(names[:SHOWN]) + more
    return [f"{count} with no geometry: treated as free floor: {listed}"]
