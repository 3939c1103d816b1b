"""A region map as a catalogue: the property :occupies, for updates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime

import numpy as np

from semmap.fields.queries.statements import (
    ALL,
    Catalogue,
    Demand,
    Entities,
    StatementRelation,
    Statements,
    VoxelColumn,
)
from semmap.fields.queries.voxel_functions import VOXEL_FUNCTIONS
from semmap.fields.regions.region_map import RegionMap
from semmap.geometry.voxel_keys import keys_of
from semmap.language.schema import Function, Property
from semmap.language.terms import PAPER_NAMESPACE

OCCUPIES = Property(
    PAPER_NAMESPACE + "occupies",
    "occupies",
    domain=None,
    range=None,
    subject="entity",
    object="voxel",
    same_as=("urn:semmap:ontology#occupies",),
)
"""The property of region maps: an entity has a voxel."""


def is_occupies(iri: str) -> bool:
    """Return whether an IRI is that of :occupies."""
    return iri in (OCCUPIES.iri, *OCCUPIES.same_as)


class RegionCatalogue:
    """A region map, and the properties of another catalogue of the same voxel size."""

    functions: Mapping[str, Function] = VOXEL_FUNCTIONS

    def __init__(self, regions: RegionMap, catalogue: Catalogue | None = None) -> None:
        self.voxel_size = regions.voxel_size
        self._regions = regions
        self._catalogue = catalogue

    def find_property(self, iri: str) -> Property:
        """Return the property of an IRI."""
        if is_occupies(iri):
            return OCCUPIES
        if self._catalogue is None:
            raise LookupError(f"there is no property {iri}: a region map has :occupies only")
        return self._catalogue.find_property(iri)

    def properties(self) -> Iterator[Property]:
        """Yield all properties."""
        yield OCCUPIES
        if self._catalogue is not None:
            yield from self._catalogue.properties()

    def find_entities(self, name: str, range_: str | None) -> frozenset[str]:
        """Return what a constant stands for, entities of the region map included."""
        is_known = any(str(each) == name for each in self._regions.entities())
        own = frozenset({name} if is_known and range_ is None else ())
        if self._catalogue is None:
            if not own:
                raise LookupError(f"the region map has no entity {name}")
            return own
        try:
            return own | self._catalogue.find_entities(name, range_)
        except LookupError:
            if own:
                return own
            raise

    def relation(self, property: Property) -> StatementRelation:
        """Return the relation that states a property."""
        if property == OCCUPIES:
            return _OccupiesRelation(self._regions)
        assert self._catalogue is not None
        return self._catalogue.relation(property)

    def during(self, begin: datetime, end: datetime) -> Catalogue:
        """Raise LookupError: a region map has no history."""
        raise LookupError("a region map has no history: leave out the time")


class _OccupiesRelation:
    """States `entity :occupies voxel`, from a region map."""

    property = OCCUPIES

    def __init__(self, regions: RegionMap) -> None:
        self._regions = regions

    def statements(self, wanted: Demand = ALL) -> Statements:
        there, subjects = self._regions.entities(), wanted.subjects
        entities = [each for each in there if subjects is None or str(each) in subjects]
        keys = [keys_of(self._regions.voxels(each)) for each in entities]
        codes = np.repeat(np.arange(len(keys), dtype=np.int32), [len(each) for each in keys])
        return Statements(
            Entities(codes, tuple(map(str, entities))),
            VoxelColumn(np.concatenate([*keys, np.zeros(0, np.int64)])),
        )
