"""The catalogue of fields: the properties of a vocabulary, stated by maps and a region map."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from datetime import datetime

import numpy as np

from semmap.fields.maps import operators
from semmap.fields.maps.lattice import Lattice
from semmap.fields.maps.map_buffer import MapBuffer, SourceUpdate
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.queries.columns import StatementRelation, UnknownError
from semmap.fields.queries.relations import (
    EntityMapRelation,
    FreeSpaceRelation,
    NumberMapRelation,
    OccupancyRelation,
    TypeRelation,
)
from semmap.fields.queries.voxel_functions import VOXEL_FUNCTIONS
from semmap.fields.regions.region_map import BODIES, NamedRegionMap, Role
from semmap.language.names import NameIndex
from semmap.language.schema import Function, Property
from semmap.suggestions import suggestion
from semmap_vdb import BoolGrid

RDF_TYPE = Property(
    "http://www.w3.org/1999/02/22-rdf-syntax-ns#type",
    "type",
    domain=None,
    range=None,
    subject="entity",
    object="entity",
)


_ROLES: Mapping[str, tuple[Role, ...]] = {
    "occupiedBy": BODIES,
    "inRoom": ("room",),
    "inZone": ("region",),
}
"""The properties that the region map states, and the roles of the entities that they name."""

_NEEDED = {"freeIn": "inRoom", "distanceToPerson": "containsPerson"}
"""The property from which another one follows."""


class FieldCatalogue:
    """The properties of a vocabulary, and what states them: maps, a region map and `relations`.

    Maps of other lattices are resampled to voxels of `voxel_size` metres; `distanceToPerson` is
    computed up to `farthest` metres. `past` makes the catalogue of a time; without it, only `maps`
    are known of the past.
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
        past: Callable[[datetime, datetime], FieldCatalogue] | None = None,
    ) -> None:
        self._vocabulary = vocabulary
        self._maps = maps
        self._names = names or NameIndex()
        self._occupancy = occupancy
        self._relations = {relation.property.name: relation for relation in relations}
        self._lattice = Lattice(voxel_size)
        self._farthest = farthest
        self._past = past
        self._selected: Callable[[], Iterable[SourceUpdate]] = maps.current
        self._is_past = False

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel in metres."""
        return self._lattice.voxel_size

    def find_property(self, iri: str) -> Property:
        """Return the property of an IRI; LookupError where none, or only its present, is known."""
        if iri == RDF_TYPE.iri:
            return RDF_TYPE
        if iri not in self._vocabulary:
            local = iri.replace("#", "/").split("/")[-1]
            known = {each.name: each.iri for each in self._vocabulary.properties}
            if local in known:
                raise LookupError(f"there is no property <{iri}>; did you mean <{known[local]}>?")
            hint = suggestion(local, list(known), f"there are {', '.join(sorted(known))}")
            raise LookupError(f"there is no property {local}{hint}")
        found = self._vocabulary[iri]
        if self._is_past and self._is_present_only(found):
            raise LookupError(f"only the present of {found.name} is known: leave out the time")
        return found

    def properties(self) -> Iterable[Property]:
        """Return all properties."""
        return [*self._vocabulary.properties, RDF_TYPE]

    def relation(self, property: Property) -> StatementRelation:
        """Return the relation that states a property; raise UnknownError if nothing states it."""
        if property == RDF_TYPE:
            return TypeRelation(RDF_TYPE, self.types(), self._names.supertypes)
        updates = tuple(self._selected())
        self._check_provided(property, updates)
        if property.name in self._relations:
            return self._relations[property.name]
        maps = [each.resampled(self._lattice) for update in updates for each in update.maps]
        own = [each for each in maps if each.property == property]
        if property.name in _ROLES:
            return OccupancyRelation(property, self._occupancy, _ROLES[property.name], own)
        if property.name == "freeIn":
            rooms = [each for each in maps if each.property.name == "inRoom"]
            in_room = OccupancyRelation(property, self._occupancy, _ROLES["inRoom"], rooms)
            return FreeSpaceRelation(property, in_room, self._occupancy)
        if property.object != "number":
            return EntityMapRelation(property, own)
        if property.name == "distanceToPerson" and not own:
            own = self._distances_to_people(property, maps)
        graded = [each for each in maps if each.value_type == "float32"]
        own += [each for each in graded if each.property.measure == property.name]
        return NumberMapRelation(property, own)

    def left_out(self) -> set[str]:
        """Return the entities without voxels, of which the relations that were read say nothing."""
        none: set[str] = set()
        return none.union(*(getattr(r, "left_out", none) for r in self._relations.values()))

    def _is_present_only(self, property: Property) -> bool:
        return property.name in ("occupiedBy", "freeIn") or property.name in self._relations

    def _distances_to_people(
        self, property: Property, maps: Sequence[RepresentationMap]
    ) -> list[RepresentationMap]:
        people = [each for each in maps if each.property.name == "containsPerson"]
        people += self._people_of_the_map()
        if not people:
            return []
        bodies = operators.union(*(_as_bool(each) for each in people))
        return [operators.distance(bodies, self._farthest, as_=property)]

    def _people_of_the_map(self) -> list[RepresentationMap]:
        """Return the bodies of the people that the map itself has."""
        if self._occupancy is None:
            return []
        people = []
        for name, several in self._occupancy.entities(*BODIES).items():
            type_ = self._names.entities.get(name)
            # An agent of no type, such as an actor of a simulation, is taken for a person.
            if type_ == "agent" or "person" in self._names.supertypes.get(type_ or "", ()):
                for each in several:
                    voxels = self._occupancy.regions.voxels(each)
                    grid = BoolGrid(self.voxel_size, False)
                    grid.set(voxels, np.ones(len(voxels), np.bool_))
                    people.append(RepresentationMap(self._vocabulary["containsPerson"], grid))
        return people

    def _check_provided(self, property: Property, updates: Sequence[SourceUpdate]) -> None:
        """Check that something states a property, so that no statement means that it is false."""
        provided = {name for update in updates for name in update.provides}
        name = _NEEDED.get(property.name, property.name)
        by_map = self._occupancy is not None and (
            name in ("occupiedBy", "inZone")
            or (name == "inRoom" and bool(self._occupancy.entities("room")))
            or (name == "containsPerson" and bool(self._people_of_the_map()))
        )
        if by_map or {name, property.name} & provided or name in self._relations:
            return
        if name == "inRoom":
            raise UnknownError(
                f"the map has no rooms, so that :{property.name} is unknown. Import rooms: a floor "
                "plan as GeoJSON, or semmap regions find"
            )
        raise UnknownError(
            f"no source provides :{name}, so that :{property.name} is unknown. Sources provide: "
            f"{', '.join(sorted(provided)) or 'nothing'}. Start one: semmap fields serve -h"
        )

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

    def during(self, begin: datetime, end: datetime) -> FieldCatalogue:
        """Return a catalogue of all maps that were valid at any time in between."""
        if self._past is not None:
            return self._past(begin, end)
        past = copy(self)
        past._selected, past._is_past = lambda: self._maps.updates(begin, end), True
        return past


def _as_bool(map: RepresentationMap) -> RepresentationMap:
    return map.like(lambda box: map.read(box).active(), value_type="bool", about=None, legend=None)
