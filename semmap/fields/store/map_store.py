"""Representation maps kept in the database, and back."""

from __future__ import annotations

from typing import Any

from semmap.fields.store import field_store
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary

__all__ = ["keep_map", "kept_map", "kept_maps"]


def keep_map(connection: Any, name: str, map: RepresentationMap) -> int:
    """Keep a map under a name; the number of its version. Raises what `field_store.save` does."""
    return field_store.save(
        connection,
        name,
        map.grid,
        property=map.property.iri,
        about=map.about,
        legend=map.legend or None,
    )


def kept_map(
    connection: Any, vocabulary: Vocabulary, name: str, version: int | None = None
) -> RepresentationMap:
    """A map that was kept, the newest version if none is named.

    Raises
    ------
    LookupError
        There is no such map or version, or the vocabulary has not its property.
    """
    kept = field_store.load(connection, name, version)
    if kept.property not in vocabulary:
        raise LookupError(
            f"the field {name} is of {kept.property}, which the vocabulary lacks: declare it"
        )
    return RepresentationMap(
        vocabulary[kept.property], kept.grid, about=kept.about, legend=kept.legend, time=kept.at
    )


def kept_maps(connection: Any, vocabulary: Vocabulary) -> dict[str, RepresentationMap]:
    """All maps that are kept of properties that the vocabulary has, by name.

    What a mirror keeps of itself is no map.
    """
    found = {}
    for name in field_store.names(connection, stateless=True):
        kept = field_store.load(connection, name)
        if kept.property in vocabulary:
            found[name] = RepresentationMap(
                vocabulary[kept.property], kept.grid, about=kept.about, legend=kept.legend,
                time=kept.at,
            )  # fmt: skip
    return found
