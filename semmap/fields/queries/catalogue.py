"""The catalogue of fields: the properties of a vocabulary, stated by maps and a region map."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import datetime

from semmap.fields.maps import operators
from semmap.fields.maps.lattice import Lattice
from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.queries.map_relations import (
    EntityMapRelation,
    FreeSpaceRelation,
    NumberMapRelation,
    OccupancyRelation,
    TypeRelation,
)
from semmap.fields.queries.statements import StatementRelation
from semmap.fields.queries.voxel_functions import VOXEL_FUNCTIONS
from semmap.fields.regions.region_map import NamedRegionMap
from semmap.language.names import NameIndex
from semmap.language.schema import Function, Property
from semmap.suggestions import suggestion

__all__ = ["RDF_TYPE", "FieldCatalogue"]

RDF_TYPE = Property(
    "http://www.w3.org/1999/02/22-rdf-syntax-ns#type",
    "type",
    domain=None,
    range=None,
    subject="entity",
    object="entity",
)


class FieldCatalogue:
    """The properties of a vocabulary, and what states them.

    Parameters
    ----------
    vocabulary : the properties
    maps : the maps of sources
    names : entities and semantic types
    occupancy : which entities occupy which voxels, for `occupiedBy` and `freeIn`
    relations : further statements about the present, such as relations between entities
    voxel_size : metres; maps of other lattices are resampled
    farthest : metres up to which `distanceToPerson` is computed
    """

    functions: Mapping[str, Function] = VOXEL_FUNCTIONS

    def __init__(
        self,
        vocabulary: Vocabulary,
        maps: MapBuffer,
        names: NameIndex | None = None,
        *,
        occupancy: NamedRegionMap | None = None,
        relations: Iterable[StatementRelation] = (),
        voxel_size: float = 0.05,
        farthest: float = 3.0,
    ) -> None:
        self._vocabulary = vocabulary
        self._maps = maps
        self._names = names or NameIndex()
        self._occupancy = occupancy
        self._relations = {relation.property.name: relation for relation in relations}
        self._lattice = Lattice(voxel_size)
        self._farthest = farthest
        self._selected: Callable[[], Sequence[RepresentationMap]] = maps.now
        self._is_past = False

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel in metres."""
        return self._lattice.voxel_size

    # Properties

    def find_property(self, iri: str) -> Property:
        """Return the property of an IRI.

        Raises
        ------
        LookupError
            There is no such property, or only its present is known.
        """
        if iri == RDF_TYPE.iri:
            return RDF_TYPE
        if iri not in self._vocabulary:
            local = iri.replace("#", "/").split("/")[-1]
            known = [each.name for each in self._vocabulary.properties]
            hint = suggestion(local, known, f"there are {', '.join(sorted(known))}")
            raise LookupError(f"there is no property {local}{hint}")
        found = self._vocabulary[iri]
        if self._is_past and self._is_present_only(found):
            raise LookupError(f"only the present of {found.name} is known: leave out the time")
        return found

    def properties(self) -> Iterable[Property]:
        """Return all properties."""
        return [*self._vocabulary.properties, RDF_TYPE]

    def relation(self, property: Property) -> StatementRelation:
        """Return the relation that states a property."""
        if property == RDF_TYPE:
            return TypeRelation(RDF_TYPE, self.types(), self._names.supertypes)
        if property.name in self._relations:
            return self._relations[property.name]
        if property.name == "occupiedBy":
            return OccupancyRelation(property, self._occupancy)
        maps = [each.resampled(self._lattice) for each in self._selected()]
        if property.name == "freeIn":
            rooms = [each for each in maps if each.property.name == "inRoom"]
            return FreeSpaceRelation(property, rooms, self._occupancy)
        own = [each for each in maps if each.property == property]
        if property.object != "number":
            return EntityMapRelation(property, own)
        if property.name == "distanceToPerson" and not own:
            own = self._distances_to_people(property, maps)
        graded = [each for each in maps if each.value_type == "float32"]
        own += [each for each in graded if each.property.measure == property.name]
        return NumberMapRelation(property, own)

    def _is_present_only(self, property: Property) -> bool:
        return property.name in ("occupiedBy", "freeIn") or property.name in self._relations

    def _distances_to_people(
        self, property: Property, maps: Sequence[RepresentationMap]
    ) -> list[RepresentationMap]:
        people = [each for each in maps if each.property.name == "containsPerson"]
        if not people:
            return []
        return [operators.distance(operators.union(*people), self._farthest, as_=property)]

    # Entities and types

    def find_entities(self, name: str, range_: str | None) -> frozenset[str]:
        """Return what a constant stands for; see `NameIndex.find`."""
        return self._names.find(name, range_, self._entities_of_maps())

    def types(self) -> dict[str, str | None]:
        """Return the type of each known entity."""
        return {**self._entities_of_maps(), **self._names.entities}

    def _entities_of_maps(self) -> dict[str, str | None]:
        """Return the entities that maps name now or lately, with the type of their property."""
        found: dict[str, str | None] = {}
        for each in self._maps.remembered():
            for name in [*each.legend.values(), *([each.about] if each.about else [])]:
                if name not in self._names.supertypes:
                    # A word of a detector for a type is an entity of that type.
                    found[name] = self._names.synonyms.get(name) or each.property.range
        if self._occupancy is not None:
            for name in self._occupancy.entities():
                found.setdefault(name, None)
        return found

    # The past

    def at(self, moment: datetime) -> FieldCatalogue:
        """Return the catalogue as it was at a moment."""
        return self._in_the_past(lambda: self._maps.at(moment))

    def during(self, begin: datetime, end: datetime) -> FieldCatalogue:
        """Return a catalogue of all maps that were valid at any time in between."""
        return self._in_the_past(lambda: self._maps.during(begin, end))

    def _in_the_past(self, selected: Callable[[], Sequence[RepresentationMap]]) -> FieldCatalogue:
        past = FieldCatalogue(
            self._vocabulary,
            self._maps,
            self._names,
            occupancy=self._occupancy,
            relations=self._relations.values(),
            voxel_size=self.voxel_size,
            farthest=self._farthest,
        )
        past._selected, past._is_past = selected, True
        return past
