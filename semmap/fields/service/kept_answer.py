"""What sources and users kept, on the grid of a mirror: for commands without a service."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING

from semmap.fields.maps.live_entities import ROLES, LiveEntities
from semmap.fields.store.map_store import load_maps
from semmap.fields.store.source_history import load_updates
from semmap.language.schema import Property
from semmap.query.snapshot import Snapshot

if TYPE_CHECKING:
    from semmap.fields.maps.vocabulary import Properties
    from semmap.fields.store.mirror_state import MirrorState


class PlainVocabulary:
    """The properties whose maps are shown on the grid, without reading the ontology."""

    def __getitem__(self, iri: str) -> Property:
        name = _local(iri)
        return Property(iri, name, None, None, "voxel", "entity", measure="degree")

    def __contains__(self, iri: object) -> bool:
        return _local(str(iri)) in ROLES


def _local(iri: str) -> str:
    return iri.replace("#", "/").split("/")[-1]


def show_kept(mirror: MirrorState, seen: Snapshot, vocabulary: Properties) -> datetime | None:
    """Put the maps that were kept last on a mirror and its grid; return when sources kept one."""
    newest = None
    for source, updates in load_updates(seen, vocabulary).items():
        for each in updates:
            mirror.maps.put(source, each.maps, each.time, provides=each.provides)
            newest = each.time if newest is None else max(newest, each.time)
    mirror.maps.put("kept", load_maps(seen, vocabulary).values())
    LiveEntities(mirror).update(mirror.maps.now())
    return newest
