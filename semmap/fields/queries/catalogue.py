"""What a query may ask: maps, the region map, and what is worked out of them, by property."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from datetime import datetime
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.fields.maps import operators
from semmap.fields.maps.map_buffer import Maps
from semmap.language.names import Names
from semmap.language.property import Property
from semmap.fields.regions.region_map import RegionMap
from semmap.fields.maps.representation_map import Lattice, RepresentationMap, VoxelBox
from semmap.fields.queries.statements import (
    Column,
    Numbers,
    Relation,
    Statements,
    Things,
    Voxels,
    keys_of,
    voxels_of_keys,
)
from semmap.fields.maps.vocabulary import Vocabulary

__all__ = ["FieldCatalogue", "Occupancy"]

TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"

Selected = Callable[[], Sequence[RepresentationMap]]


class Occupancy:
    """A region map whose entities are told by name.

    Parameters
    ----------
    names : the name of each entity of the region map; the entity itself where it has none
    """

    def __init__(self, regions: RegionMap, names: Mapping[Any, str] | None = None) -> None:
        self.regions = regions
        self._names = names or {}

    def entities(self) -> dict[str, Any]:
        """The entities that have voxels, by name."""
        return {self._names.get(e, str(e)): e for e in self.regions.entities()}


class FieldCatalogue:
    """Properties of a vocabulary, stated by what there is.

    Parameters
    ----------
    vocabulary : which properties there are
    maps : what sources gave
    names : entities and types
    occupancy : which entities are where, for `occupiedBy` and `freeIn`
    relations : what else states something, such as relations of things; they hold now only
    voxel_size : metres; maps of other lattices are brought to this one
    farthest : metres up to which `distanceToPerson` is told
    """

    def __init__(
        self,
        vocabulary: Vocabulary,
        maps: Maps,
        names: Names | None = None,
        *,
        occupancy: Occupancy | None = None,
        relations: Iterable[Relation] = (),
        voxel_size: float = 0.05,
        farthest: float = 3.0,
    ) -> None:
        self._vocabulary = vocabulary
        self._maps = maps
        self._names = names or Names()
        self._occupancy = occupancy
        self._extra = {relation.property.name: relation for relation in relations}
        self._lattice = Lattice(voxel_size)
        self._farthest = farthest
        self._selected: Selected = maps.now
        self._past = False

    @property
    def voxel_size(self) -> float:
        return self._lattice.voxel_size

    def relation(self, iri: str) -> Relation:
        if iri == TYPE:
            return _TypeRelation(self)
        if iri not in self._vocabulary:
            words = [p.name for p in self._vocabulary.properties]
            local = iri.replace("#", "/").split("/")[-1]
            near = ", ".join(get_close_matches(local, words, n=3)) or ", ".join(sorted(words))
            raise LookupError(f"there is no property {local}; near it: {near}")
        return self._stated(self._vocabulary[iri])

    def relations(self) -> Iterable[Relation]:
        return [self.relation(p.iri) for p in self._vocabulary.properties] + [_TypeRelation(self)]

    def things(self, name: str, range_: str | None) -> frozenset[str]:
        return self._names.things(name, range_, self.known())

    def at(self, moment: datetime) -> FieldCatalogue:
        return self._when(lambda: self._maps.at(moment))

    def during(self, begin: datetime, end: datetime) -> FieldCatalogue:
        return self._when(lambda: self._maps.during(begin, end))

    def known(self) -> dict[str, str | None]:
        """Things that maps name or are about, now or of late, with the type of their property."""
        found: dict[str, str | None] = {}
        for each in self._maps.remembered():
            for name in [*each.legend.values(), *([each.about] if each.about else [])]:
                if name not in self._names.supers:
                    # A detector's own word for a type is a thing of that type.
                    found[name] = self._names.synonyms.get(name) or each.property.range
        if self._occupancy is not None:
            for name in self._occupancy.entities():
                found.setdefault(name, None)
        return found

    def types(self) -> dict[str, str | None]:
        """The type of each thing that is known."""
        return {**self.known(), **self._names.entities}

    def supers(self, type_: str) -> frozenset[str]:
        """The types that subsume one."""
        return self._names.supers.get(type_, frozenset({type_}))

    def _when(self, selected: Selected) -> FieldCatalogue:
        then = FieldCatalogue(
            self._vocabulary, self._maps, self._names, occupancy=self._occupancy,
            relations=self._extra.values(), voxel_size=self.voxel_size, farthest=self._farthest,
        )  # fmt: skip
        then._selected, then._past = selected, True
        return then

    def _stated(self, property: Property) -> Relation:
        maps = [m.resampled(self._lattice) for m in self._selected()]
        own = [m for m in maps if m.property == property]
        if property.name in ("occupiedBy", "freeIn") or property.name in self._extra:
            if self._past:
                raise LookupError(f"{property.name} is known of now only; leave out the time")
            if property.name in self._extra:
                return self._extra[property.name]
            if property.name == "occupiedBy":
                return _OccupiedRelation(property, self._occupancy)
            rooms = [m for m in maps if m.property.name == "inRoom"]
            return _FreeRelation(property, rooms, self._occupancy)
        if property.name == "distanceToPerson" and not own:
            people = [m for m in maps if m.property.name == "containsPerson"]
            if people:
                nearest = operators.distance(operators.union(*people), self._farthest, as_=property)
                own = [nearest]
        if property.object == "number":
            graded = [m for m in maps if m.value_type == "float32"]
            own += [m for m in graded if m.property.measure == property.name]
            return _NumberRelation(property, own)
        return _ThingRelation(property, own)


class _ThingRelation:
    """`voxel property thing`, of bool maps about things and int32 maps of a legend."""

    def __init__(self, property: Property, maps: Sequence[RepresentationMap]) -> None:
        self.property = property
        self._maps = maps

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        found: list[tuple[str, NDArray[np.int64]]] = []
        box = _box_of(within)
        about: dict[tuple[str, str], list[RepresentationMap]] = {}
        for each in self._maps:
            if each.legend:
                wanted = {
                    value: name
                    for value, name in each.legend.items()
                    if objects is None or name in objects
                }
                if wanted:
                    voxels, values = _read(each, box)
                    keys = keys_of(voxels)
                    found += [(name, keys[values == value]) for value, name in wanted.items()]
            elif each.about is not None and (objects is None or each.about in objects):
                about.setdefault((each.about, each.value_type), []).append(each)
        # Of a time there are many about one: joined as grids, they are sorted once.
        for (name, _), several in about.items():
            found.append((name, keys_of(_read(operators.union(*several), box)[0])))
        return _by_thing(found)


class _NumberRelation:
    """`voxel property number`; where several maps have one, the largest."""

    def __init__(self, property: Property, maps: Sequence[RepresentationMap]) -> None:
        self.property = property
        self._maps = maps

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        box = _box_of(within)
        keys: list[NDArray[np.int64]] = [np.zeros(0, np.int64)]
        values: list[NDArray[np.float64]] = [np.zeros(0)]
        for each in self._maps:
            voxels, numbers = _read(each, box)
            keys.append(keys_of(voxels))
            values.append(numbers.astype(np.float64))
        key, value = np.concatenate(keys), np.concatenate(values)
        order = np.lexsort((value, key))
        key, value = key[order], value[order]
        last = np.append(key[1:] != key[:-1], True) if len(key) else np.zeros(0, np.bool_)
        return Statements(Voxels(key[last]), Numbers(value[last]))


class _OccupiedRelation:
    """`voxel occupiedBy entity`, of a region map."""

    def __init__(self, property: Property, occupancy: Occupancy | None) -> None:
        self.property = property
        self._occupancy = occupancy

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        if self._occupancy is None:
            return _by_thing([])
        regions = self._occupancy.regions
        return _by_thing(
            [
                (name, keys_of(regions.voxels(entity)))
                for name, entity in self._occupancy.entities().items()
                if objects is None or name in objects
            ]
        )


class _FreeRelation:
    """`voxel freeIn room`: of the room, and of no entity."""

    def __init__(
        self, property: Property, rooms: Sequence[RepresentationMap], occupancy: Occupancy | None
    ) -> None:
        self.property = property
        self._rooms = _ThingRelation(property, rooms)
        self._occupancy = occupancy

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        subject, thing = self._rooms.statements(objects=objects, within=within)
        assert isinstance(subject, Voxels)
        assert isinstance(thing, Things)
        if self._occupancy is None:
            return Statements(subject, thing)
        regions = self._occupancy.regions
        centres = (voxels_of_keys(subject.keys) + 0.5) * regions.voxel_size
        free = regions.set_numbers_at(centres) == 0
        return Statements(Voxels(subject.keys[free]), Things(thing.codes[free], thing.names))


class _TypeRelation:
    """`thing a type`, the types that subsume its own among them."""

    property = Property(TYPE, "type", None, None, subject="thing", object="thing")

    def __init__(self, catalogue: FieldCatalogue) -> None:
        self._catalogue = catalogue

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        pairs = [
            (thing, super_)
            for thing, type_ in self._catalogue.types().items()
            if type_ is not None and (subjects is None or thing in subjects)
            for super_ in self._catalogue.supers(type_)
            if objects is None or super_ in objects
        ]
        return Statements(Things.of(a for a, _ in pairs), Things.of(b for _, b in pairs))


def _by_thing(found: Sequence[tuple[str, NDArray[np.int64]]]) -> Statements:
    """Rows of voxels by thing; those of one thing that several maps name come once."""
    of: dict[str, list[NDArray[np.int64]]] = {}
    for name, keys in found:
        of.setdefault(name, []).append(keys)
    each = [np.unique(np.concatenate(keys)) for keys in of.values()]
    subject: Column = Voxels(np.concatenate([np.zeros(0, np.int64), *each]))
    codes = np.repeat(np.arange(len(each), dtype=np.int32), [len(keys) for keys in each])
    return Statements(subject, Things(codes, tuple(of)))


def _read(
    map: RepresentationMap, box: VoxelBox | None
) -> tuple[NDArray[np.int32], NDArray[np.int32] | NDArray[np.float32] | NDArray[np.bool_]]:
    return (map.grid if box is None else map.within(box)).read()


def _box_of(within: NDArray[np.int64] | None) -> VoxelBox | None:
    if within is None:
        return None
    if not len(within):
        return VoxelBox((0, 0, 0), (-1, -1, -1))
    voxels = voxels_of_keys(within)
    low, high = voxels.min(axis=0).tolist(), voxels.max(axis=0).tolist()
    return VoxelBox(tuple(low), tuple(high))
