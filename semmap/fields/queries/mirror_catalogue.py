"""What queries may ask of a mirrored map, relations of its things among it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.fields.queries.catalogue import FieldCatalogue, Occupancy
from semmap.fields.store.voxel_mirror import Mirror
from semmap.language.names import Names
from semmap.language.property import Property
from semmap.fields.relations.relations import RULES, Relations
from semmap.fields.queries.statements import Statements
from semmap.fields.queries.entity_relation import ThingRelation
from semmap.fields.maps.vocabulary import Vocabulary

__all__ = ["catalogue_of"]


def catalogue_of(mirror: Mirror, names: Names, vocabulary: Vocabulary) -> FieldCatalogue:
    """A catalogue of what a mirror has: what fills space, zones, and how things stand.

    Relations are worked out when the first of them is asked for.
    """
    stand = _Standing(mirror)
    relations = [
        _LazyRelation(vocabulary[rule.name], stand) for rule in RULES if rule.name in vocabulary
    ]
    return FieldCatalogue(
        vocabulary,
        mirror.maps,
        names,
        occupancy=Occupancy(mirror.regions, mirror.names),
        relations=relations,
        voxel_size=mirror.regions.voxel_size,
    )


class _Standing:
    def __init__(self, mirror: Mirror) -> None:
        self._mirror = mirror

    @cached_property
    def relations(self) -> Relations:
        """How things stand to each other now."""
        names: Mapping[Any, Any] = self._mirror.names
        made = Relations(self._mirror.regions, names=names)
        made.update(self._mirror.regions.entities())
        return made


class _LazyRelation:
    def __init__(self, property: Property, stand: _Standing) -> None:
        self.property = property
        self._stand = stand

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        relation = ThingRelation(self.property, self._stand.relations)
        return relation.statements(subjects=subjects, objects=objects, within=within)
