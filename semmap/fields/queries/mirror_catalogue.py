"""The catalogue of a mirror: what fills space, zones, and relations between entities."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.queries.catalogue import FieldCatalogue
from semmap.fields.queries.entity_relation import EntityRelation
from semmap.fields.regions.region_map import NamedRegionMap
from semmap.fields.relations.rules import RULES
from semmap.fields.relations.tracker import RelationTracker
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.language.names import NameIndex

__all__ = ["mirror_catalogue"]


def mirror_catalogue(
    mirror: VoxelMirror, names: NameIndex, vocabulary: Vocabulary
) -> FieldCatalogue:
    """Return the catalogue of a mirror.

    Relations between entities are computed when the first of them is read.

    Parameters
    ----------
    mirror : the voxels and zones of a map
    names : its entities and the semantic types
    vocabulary : the properties
    """
    entity_names: Mapping[Any, Any] = mirror.names

    @cache
    def tracker() -> RelationTracker:
        relations = RelationTracker(mirror.regions, names=entity_names)
        relations.update(mirror.regions.entities())
        return relations

    return FieldCatalogue(
        vocabulary,
        mirror.maps,
        names,
        occupancy=NamedRegionMap(mirror.regions, mirror.names),
        relations=[
            EntityRelation(vocabulary[rule.name], tracker)
            for rule in RULES
            if rule.name in vocabulary
        ],
        voxel_size=mirror.regions.voxel_size,
    )
