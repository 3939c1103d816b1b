"""Statements of maps, of a region map, of types, and of relations between entities."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from semmap.fields.maps import operators
from semmap.fields.maps.lattice import VoxelBox
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.queries.columns import (
    ALL,
    Demand,
    Entities,
    Numbers,
    Statements,
    UnknownError,
    VoxelColumn,
)
from semmap.fields.queries.table import LimitError
from semmap.fields.regions.region_map import BODIES, NamedRegionMap, Role
from semmap.fields.relations.facts import RelationFact
from semmap.fields.relations.rules import RelationRule
from semmap.geometry.voxel_keys import keys_of, sorted_unique, voxels_of_keys
from semmap.language.schema import Property
from semmap.limits import QUERY_ROWS

Keys = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class EntityMapRelation:
    """States `voxel property entity`, of bool maps about entities and int32 maps with legends."""

    property: Property
    maps: Sequence[RepresentationMap]  # of that property

    def statements(self, wanted: Demand = ALL) -> Statements:
        """Return the statements that are wanted."""
        return _by_entity(self.found(wanted))

    def found(self, wanted: Demand) -> list[tuple[str, Keys]]:
        """Return entities with the keys of their voxels; an entity may occur more than once."""
        found: list[tuple[str, Keys]] = []
        box, objects = _box_around(wanted.within), wanted.objects
        about: dict[tuple[str, str], list[RepresentationMap]] = {}
        for each in self.maps:
            if each.legend:
                named = {
                    value: name
                    for value, name in each.legend.items()
                    if objects is None or name in objects
                }
                if named:
                    voxels, values = _read(each, box)
                    keys = keys_of(voxels)
                    found += [(name, keys[values == value]) for value, name in named.items()]
            elif each.about is not None and (objects is None or each.about in objects):
                about.setdefault((each.about, each.value_type), []).append(each)
        # DURING selects many maps about one entity: joined as grids they are sorted only once.
        for (name, _), several in about.items():
            found.append((name, keys_of(_read(operators.union(*several), box)[0])))
        return found


@dataclass(frozen=True, eq=False)
class NumberMapRelation:
    """States `voxel property number`; where several maps have a number, the largest."""

    property: Property
    maps: Sequence[RepresentationMap]  # of numbers

    def statements(self, wanted: Demand = ALL) -> Statements:
        """Return the statements that are wanted."""
        box = _box_around(wanted.within)
        keys: list[Keys] = [np.zeros(0, np.int64)]
        values: list[NDArray[np.float64]] = [np.zeros(0)]
        for each in self.maps:
            voxels, numbers = _read(each, box)
            keys.append(keys_of(voxels))
            values.append(numbers.astype(np.float64))
        key, value = np.concatenate(keys), np.concatenate(values)
        order = np.lexsort((value, key))
        key, value = key[order], value[order]
        last = np.append(key[1:] != key[:-1], True) if len(key) else np.zeros(0, np.bool_)
        return Statements(VoxelColumn(key[last]), Numbers(value[last]))


@dataclass(frozen=True, eq=False)
class OccupancyRelation:
    """States which entities of a region map have a voxel: `occupiedBy`, `inRoom`, `inZone`."""

    property: Property
    occupancy: NamedRegionMap | None  # None states nothing
    roles: Sequence[Role] = BODIES  # of the entities
    maps: Sequence[RepresentationMap] = ()  # of that property, which state it, too

    def counts(self, objects: Collection[str] | None = None) -> dict[str, int] | None:
        """Return the number of voxels of each entity; None where only reading them tells it."""
        if self.occupancy is None or self.maps:
            return None
        size, found = self.occupancy.regions.size, self.occupancy.entities(*self.roles)
        if any(len(several) > 1 for several in found.values()):
            return None
        return {
            name: size(entity)
            for name, (entity,) in found.items()
            if objects is None or name in objects
        }

    def statements(self, wanted: Demand = ALL) -> Statements:
        """Return the statements that are wanted."""
        objects = wanted.objects
        counts = self.counts(objects) or {}
        _check_rows(self.property, sum(counts.values()), len(counts))
        found = EntityMapRelation(self.property, self.maps).found(wanted)
        if self.occupancy is not None:
            regions = self.occupancy.regions
            found += [
                (name, keys_of(regions.voxels(entity)))
                for name, several in self.occupancy.entities(*self.roles).items()
                if objects is None or name in objects
                for entity in several
            ]
        return _by_entity(found)


@dataclass(frozen=True, eq=False)
class FreeSpaceRelation:
    """States `voxel freeIn room`: voxels of the room that no entity occupies."""

    property: Property
    rooms: OccupancyRelation  # states `voxel inRoom room`
    occupancy: NamedRegionMap | None  # None for no entities

    def counts(self, objects: Collection[str] | None = None) -> dict[str, int] | None:
        """Return the number of free voxels of each room, as `OccupancyRelation.counts`.

        It is that of the room without those that bodies share with it, so that only voxels of
        bodies are looked at.
        """
        counts = self.rooms.counts(objects)
        if counts is None or self.occupancy is None:
            return counts
        regions = self.occupancy.regions
        bodies = self.occupancy.entities(*BODIES).values()
        filled = [keys_of(regions.voxels(each)) for several in bodies for each in several]
        keys = sorted_unique(np.concatenate([np.zeros(0, np.int64), *filled]))
        points = (voxels_of_keys(keys) + 0.5) * regions.voxel_size
        numbers, times = np.unique(regions.set_numbers_at(points), return_counts=True)
        sets = regions.sets(numbers)
        rooms = {
            each: name
            for name, several in self.occupancy.entities("room").items()
            if name in counts
            for each in several
        }
        for number, n in zip(numbers.tolist(), times.tolist(), strict=True):
            for room in sets[number] & rooms.keys():
                counts[rooms[room]] -= n
        return counts

    def statements(self, wanted: Demand = ALL) -> Statements:
        """Return the statements that are wanted."""
        voxels, rooms = self.rooms.statements(wanted)
        assert isinstance(voxels, VoxelColumn)
        assert isinstance(rooms, Entities)
        if self.occupancy is None:
            return Statements(voxels, rooms)
        size = self.occupancy.regions.voxel_size
        free = ~self.occupancy.occupied((voxels_of_keys(voxels.keys) + 0.5) * size)
        return Statements(VoxelColumn(voxels.keys[free]), Entities(rooms.codes[free], rooms.names))


@dataclass(frozen=True, eq=False)
class TypeRelation:
    """States `entity rdf:type type`, for all types that subsume that of the entity."""

    property: Property
    types: Mapping[str, str | None]  # of each entity
    supertypes: Mapping[str, frozenset[str]]  # for each type all that subsume it, itself included

    def statements(self, wanted: Demand = ALL) -> Statements:
        """Return the statements that are wanted."""
        subjects, objects, _ = wanted
        pairs = [
            (entity, supertype)
            for entity, type_ in self.types.items()
            if type_ is not None and (subjects is None or entity in subjects)
            for supertype in self.supertypes.get(type_, frozenset({type_}))
            if objects is None or supertype in objects
        ]
        return Statements(
            Entities.from_names(entity for entity, _ in pairs),
            Entities.from_names(supertype for _, supertype in pairs),
        )


class Relations(Protocol):
    """What is true: a `RelationTracker`, or what was true in the past."""

    @property
    def rules(self) -> tuple[RelationRule, ...]:
        """The rules of the relations."""
        ...

    def holding(self, relation: str | None = None) -> Mapping[RelationFact, Any]:
        """Return the facts, of one relation if given."""
        ...


@dataclass(eq=False)
class EntityRelation:
    """States `entity property entity`, from the relation that has the property's name."""

    property: Property  # its `name` is that of a rule: `in`, `on`, `touching`, `near` or `sees`
    tracker: Callable[[], Relations]  # named as in facts; called when statements are read
    # returns the entities that have no voxels, whose relations are therefore unknown
    unknown: Callable[[], Collection[str]] = tuple
    # returns the property that nothing provides, and without which all is unknown
    missing: Callable[[], str | None] = lambda: None
    left_out: set[str] = field(default_factory=set)  # by the statements that were read

    def statements(self, wanted: Demand = ALL) -> Statements:
        """Return the statements that are wanted.

        Raises UnknownError: all entities to which a side is limited have no voxels, or what the
        relation follows from is missing. Raises LookupError: no rule of the tracker has the
        property's name.
        """
        subjects, objects, _ = wanted
        tracker, name = self.tracker(), self.property.name
        known = [rule.name for rule in tracker.rules]
        if name not in known:
            raise LookupError(f"there is no relation {name}; relations: {', '.join(known)}")
        missing = self.missing()
        if missing is not None:
            raise UnknownError(
                f"no source provides :{missing}, so that :{name} is unknown. Start one: semmap "
                "fields serve -h"
            )
        for side in (subjects, objects):
            self._check_known(side)
        facts = sorted((str(fact.subject), str(fact.object)) for fact in tracker.holding(name))
        holding = [
            (subject, object)
            for subject, object in facts
            if (subjects is None or subject in subjects) and (objects is None or object in objects)
        ]
        return Statements(
            Entities.from_names(subject for subject, _ in holding),
            Entities.from_names(object for _, object in holding),
        )

    def _check_known(self, names: Collection[str] | None) -> None:
        without = set(self.unknown())
        self.left_out |= without if names is None else without & set(names)
        if names and without.issuperset(names):
            shown = ", ".join(sorted(names)[:5])
            raise UnknownError(
                f"{shown}: no voxels, so that :{self.property.name} is unknown. Give the entity a "
                "geometry, or ask for its holder: semmap show NAME"
            )


def _check_rows(property: Property, rows: int, entities: int) -> None:
    if QUERY_ROWS.exceeded_by(rows):
        raise LimitError(
            f"?v :{property.name} ?e has {rows:,} solutions, the voxels of {entities} entities; "
            "name an entity in place of ?e, or count voxels: SELECT ?e (COUNT(?v) AS ?n) "
            f"{{ ?v :{property.name} ?e }} GROUP BY ?e; {QUERY_ROWS.variable} raises the limit of "
            f"{QUERY_ROWS.value:,}"
        )


def _by_entity(found: Sequence[tuple[str, Keys]]) -> Statements:
    """Return rows of voxels for each entity; voxels of several maps occur once."""
    keys_of_entity: dict[str, list[Keys]] = {}
    for name, keys in found:
        keys_of_entity.setdefault(name, []).append(keys)
    each = [sorted_unique(np.concatenate(keys)) for keys in keys_of_entity.values()]
    voxels = VoxelColumn(np.concatenate([np.zeros(0, np.int64), *each]))
    codes = np.repeat(np.arange(len(each), dtype=np.int32), [len(keys) for keys in each])
    return Statements(voxels, Entities(codes, tuple(keys_of_entity)))


def _read(
    map: RepresentationMap, box: VoxelBox | None
) -> tuple[NDArray[np.int32], NDArray[np.int32] | NDArray[np.float32] | NDArray[np.bool_]]:
    return (map.grid if box is None else map.within(box)).read()


def _box_around(within: Keys | None) -> VoxelBox | None:
    """Return the box around voxels; None for everywhere."""
    if within is None:
        return None
    if not len(within):
        return VoxelBox((0, 0, 0), (-1, -1, -1))
    voxels = voxels_of_keys(within)
    low, high = voxels.min(axis=0).tolist(), voxels.max(axis=0).tolist()
    return VoxelBox(tuple(low), tuple(high))
