"""Representation maps in the database."""

from __future__ import annotations

from datetime import datetime
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

from semmap.fields.maps.map_buffer import SourceUpdate
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.store import field_store
from semmap.query.snapshot import Snapshot

if TYPE_CHECKING:
    from semmap.fields.maps.vocabulary import Properties


def save_map(connection: Any, name: str, map: RepresentationMap, **more: Any) -> int:
    """Store a map as the newest version of a field, with `more` as in `field_store.save`."""
    return field_store.save(
        connection,
        name,
        map.grid,
        property=map.property.iri,
        about=map.about,
        legend=map.legend or None,
        **more,
    )


def load_map(
    seen: Snapshot, vocabulary: Properties, name: str, version: int | None = None
) -> RepresentationMap | None:
    """Return a version of a stored map, by default the newest; None if its property is unknown."""
    stored = field_store.load(seen, name, version)
    if stored.property not in vocabulary:
        return None
    return RepresentationMap(
        vocabulary[stored.property],
        stored.grid,
        about=stored.about,
        legend=stored.legend,
        time=stored.at,
    )


def load_maps(seen: Snapshot, vocabulary: Properties) -> dict[str, RepresentationMap]:
    """Return by name the newest versions of all stored maps with a property of the vocabulary."""
    names = field_store.names(seen)
    found = ((name, load_map(seen, vocabulary, name)) for name in names)
    return {name: map for name, map in found if map is not None}


def load_maps_during(
    seen: Snapshot, vocabulary: Properties, begin: datetime, end: datetime
) -> list[SourceUpdate]:
    """Return the versions of stored maps that were the newest at any time in between, aware."""
    found = []
    for name in field_store.names(seen):
        versions = field_store.versions(seen, name)
        until = [each.at for each in versions[1:]]
        for each, over in zip_longest(versions, until):
            if each.at <= end and (over is None or over > begin):
                made = load_map(seen, vocabulary, name, each.version)
                if made is not None:
                    provides = frozenset({made.property.name})
                    found.append(SourceUpdate(each.at, (made,), provides, f"kept {name}"))
    return found
