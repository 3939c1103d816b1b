"""A catalogue of lists, for the package and, as triples, for rdflib."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np
import rdflib
from numpy.typing import NDArray

from semmap.fields.queries.columns import (
    ALL,
    Demand,
    Entities,
    Numbers,
    StatementColumn,
    StatementRelation,
    Statements,
    VoxelColumn,
)
from semmap.fields.queries.voxel_functions import VOXEL_FUNCTIONS
from semmap.geometry.voxel_keys import keys_of, voxels_of_keys
from semmap.language.schema import Function, Property, SideKind
from semmap.suggestions import suggestion

KB = "http://kb.openrobots.org/"
PREFIX = f"PREFIX : <{KB}>\n"


def prop(
    name: str,
    range_: str | None = None,
    *,
    domain: str | None = None,
    subject: SideKind = "voxel",
    object: SideKind = "entity",
) -> Property:
    """Return a property in the namespace of the paper."""
    return Property(KB + name, name, domain, range_, subject, object)


@dataclass
class Listed:
    """A relation with all its statements; it records the arguments of each call."""

    property: Property
    subjects: list[tuple[int, int, int]] | list[str]
    objects: list[str] | list[float]
    withins: list[NDArray[np.int64] | None] = field(default_factory=list)
    limited: list[tuple[Collection[str] | None, Collection[str] | None]] = field(
        default_factory=list
    )

    def statements(self, wanted: Demand = ALL) -> Statements:
        """Return the statements."""
        subjects, objects, within = wanted
        self.withins.append(within)
        self.limited.append((subjects, objects))
        rows = [
            i
            for i, (s, o) in enumerate(zip(self.subjects, self.objects, strict=True))
            if (subjects is None or s in subjects) and (objects is None or o in objects)
        ]
        if within is not None:
            keys = keys_of(np.array(self.subjects, np.int32).reshape(-1, 3))
            rows = [i for i in rows if keys[i] in within]
        return Statements(
            _column(self.property.subject, [self.subjects[i] for i in rows]),
            _column(self.property.object, [self.objects[i] for i in rows]),
        )


def _column(kind: SideKind, values: list) -> StatementColumn:  # type: ignore[type-arg]
    if kind == "voxel":
        return VoxelColumn(keys_of(np.array(values, np.int32).reshape(-1, 3)))
    if kind == "number":
        return Numbers(np.array(values, float))
    names = tuple(sorted(set(values)))
    return Entities(np.array([names.index(v) for v in values], np.int32), names)


@dataclass
class Arrays:
    """Relations, the type of each entity, and the supertype of each type."""

    given: list[StatementRelation]
    types: Mapping[str, str] = field(default_factory=dict)
    supertypes: Mapping[str, str] = field(default_factory=dict)
    voxel_size: float = 0.5
    past: Mapping[datetime, Arrays] = field(default_factory=dict)
    spans: list[tuple[datetime, datetime]] = field(default_factory=list)

    functions: Mapping[str, Function] = field(default_factory=lambda: VOXEL_FUNCTIONS)

    def find_property(self, iri: str) -> Property:
        """Return the property of an IRI."""
        for each in self.given:
            if each.property.iri == iri:
                return each.property
        names = [each.property.name for each in self.given]
        raise KeyError(f"there is no property {iri}{suggestion(iri.removeprefix(KB), names)}")

    def properties(self) -> Iterable[Property]:
        """Return all properties."""
        return [each.property for each in self.given]

    def relation(self, property: Property) -> StatementRelation:
        """Return the relation of a property."""
        return next(each for each in self.given if each.property == property)

    def _is_a(self, name: str, type_: str) -> bool:
        while name != type_ and name in self.supertypes:
            name = self.supertypes[name]
        return name == type_

    def find_entities(self, name: str, range_: str | None) -> frozenset[str]:
        """Return an entity, or a type and its subtypes."""
        every = {*self.types, *self.types.values(), *self.supertypes, *self.supertypes.values()}
        if name not in every:
            raise KeyError(f"there is no entity and no type {name}")
        found = {n for n in every if n == name or self._is_a(n, name)} - set(self.types)
        found |= {name} if name in self.types else set()
        own = self.types.get(name, name)
        if range_ is not None and not self._is_a(own, range_):
            raise TypeError(f"{name} is not of the type {range_}")
        return frozenset(found)

    def during(self, begin: datetime, end: datetime) -> Arrays:
        """Return the catalogue of a time span, or of a moment."""
        if begin == end:
            if begin not in self.past:
                raise LookupError(f"{begin} is not recorded")
            return self.past[begin]
        self.spans.append((begin, end))
        return next((a for t, a in self.past.items() if begin <= t <= end), self)

    def graph(self) -> rdflib.Graph:
        """Return all statements as triples."""
        graph = rdflib.Graph()
        for each in self.given:
            stated = each.statements()
            for s, o in zip(terms(stated.subject), terms(stated.object), strict=True):
                graph.add((s, rdflib.URIRef(each.property.iri), o))
        return graph


def terms(column: StatementColumn) -> list[rdflib.term.Identifier]:
    """Return a term for each value."""
    match column:
        case VoxelColumn(keys):
            return [voxel_iri(voxel) for voxel in voxels_of_keys(keys).tolist()]
        case Entities(codes, names):
            return [rdflib.URIRef(KB + names[code]) for code in codes.tolist()]
        case Numbers(values):
            return [rdflib.Literal(value) for value in values.tolist()]


def voxel_iri(voxel: Iterable[int]) -> rdflib.URIRef:
    """Return the IRI of a voxel."""
    return rdflib.URIRef("urn:voxel:" + "_".join(map(str, voxel)))


# A table, a mug on it that human1 sees, a cup beside it, free space with distances.

TYPES = {
    "human1": "agent",
    "human2": "agent",
    "table1": "table",
    "mug1": "coffee_mug",
    "cup1": "cup",
    "robot": "agent",
}
SUPERTYPES = {
    "agent": "entity",
    "artifact": "entity",
    "table": "artifact",
    "mug": "artifact",
    "cup": "artifact",
    "coffee_mug": "mug",
    "person": "agent",
}


def kitchen() -> Arrays:
    """Return a scene with solutions of the query of the paper."""
    mug = [(4, 4, z) for z in range(2, 6)]
    cup = [(6, 4, z) for z in range(2, 5)]
    table = [(x, y, 1) for x in range(2, 9) for y in range(2, 7)]
    seen = [(x, y, z) for x in range(3, 7) for y in range(3, 6) for z in range(1, 4)]
    seen2 = [(6, 4, 2), (7, 4, 2), (4, 4, 3)]
    free = [(x, 0, 0) for x in range(8)]
    near = [0.25 * x for x in range(8)]
    return Arrays(
        [
            Listed(
                prop("containsObject", "artifact", domain="artifact"),
                mug + cup + table,
                ["coffee_mug"] * len(mug) + ["cup"] * len(cup) + ["table"] * len(table),
            ),
            Listed(
                prop("inFieldOfView", "agent"),
                seen + seen2,
                ["human1"] * len(seen) + ["human2"] * len(seen2),
            ),
            Listed(
                prop("occupiedBy"),
                mug + cup + table,
                ["mug1"] * len(mug) + ["cup1"] * len(cup) + ["table1"] * len(table),
            ),
            Listed(prop("on", "entity", subject="entity"), ["mug1", "cup1"], ["table1", "table1"]),
            Listed(prop("free"), free, ["robot"] * len(free)),
            Listed(prop("distanceToPerson", object="number"), free, near),
        ],
        TYPES,
        SUPERTYPES,
    )
