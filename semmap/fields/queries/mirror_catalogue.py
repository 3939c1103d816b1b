"""The catalogue of a mirror: what fills space, zones, and relations between entities."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.queries.catalogue import FieldCatalogue
from semmap.fields.queries.entity_relation import EntityRelation
from semmap.fields.queries.past_catalogue import Open, past_catalogue
from semmap.fields.regions.region_map import NamedRegionMap
from semmap.fields.relations.rules import RULES
from semmap.fields.relations.tracker import RelationTracker
from semmap.fields.store.mirror_state import MirrorState
from semmap.language.names import NameIndex

if TYPE_CHECKING:
    from semmap.fields.store.voxel_mirror import VoxelMirror


def mirror_catalogue(
    mirror: MirrorState | VoxelMirror,
    names: NameIndex,
    vocabulary: Vocabulary,
    tracker: Callable[[], RelationTracker] | None = None,
    open_snapshot: Open | None = None,
) -> FieldCatalogue:
    """Return the catalogue of a mirror; relations are computed when the first of them is read.

    `tracker` returns them if something else updates them. `open_snapshot` opens a state of the map,
    for its past; without it, only the maps of `mirror` are known of the past.
    """
    entity_names: Mapping[Any, Any] = mirror.names

    occupancy = NamedRegionMap(mirror.regions, mirror.names, mirror.roles)

    @cache
    def computed() -> RelationTracker:
        relations = RelationTracker(
            mirror.regions, names=entity_names, views=mirror.views, spaces=mirror.spaces
        )
        relations.update(mirror.regions.entities())
        return relations

    def unknown() -> set[str]:
        agents = set(mirror.views.values())  # an agent sees by its view, whether seen or not
        return {*names.entities} - occupancy.entities().keys() - agents

    def missing() -> str | None:
        provided = {name for update in mirror.maps.current() for name in update.provides}
        return None if mirror.views or "inFieldOfView" in provided else "inFieldOfView"

    return FieldCatalogue(
        vocabulary,
        mirror.maps,
        names,
        occupancy=occupancy,
        relations=[
            EntityRelation(vocabulary[name], tracker or computed, unknown, missing)
            if name == "sees"
            else EntityRelation(vocabulary[name], tracker or computed, unknown)
            for name in dict.fromkeys(rule.name for rule in RULES)
            if name in vocabulary
        ],
        voxel_size=mirror.regions.voxel_size,
        past=(
            None
            if open_snapshot is None
            else past_catalogue(mirror, names, vocabulary, open_snapshot)
        ),
    )
