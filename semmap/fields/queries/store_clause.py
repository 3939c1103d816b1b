"""STORE: what makes a new map of the solutions of a query (reMap, section 4)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from semmap.fields.queries.columns import (
    Catalogue,
    Entities,
    Numbers,
    Statements,
    VoxelColumn,
)
from semmap.fields.queries.expressions import Context
from semmap.fields.queries.query_result import StoreResult
from semmap.fields.queries.table import Table, unbound
from semmap.language.algebra import Pattern, TriplePattern, Union
from semmap.language.checker import Checker
from semmap.language.parser import ParsedText
from semmap.language.schema import Property, with_article
from semmap.language.terms import EVERYTHING, position_of

STORED_OBJECT = "*object"
"""The variable for the object that a voxel gets where SELECT does not name it."""


class StoreChecker(Checker):
    """Checks a query with STORE, and makes its result.

    SELECT names a voxel, or a voxel and its object. With a voxel alone, the object is that of the
    triple patterns in WHERE with this voxel and the property of STORE.
    """

    hidden = frozenset({STORED_OBJECT})

    def __init__(self, parsed: ParsedText, catalogue: Catalogue) -> None:
        super().__init__(parsed, catalogue)
        self.property: Property = self.find_property(parsed.store)
        self._catalogue = catalogue
        self._subject = str(parsed.names[0]) if len(parsed.names) == 1 else None
        self._objects: list[int] = []  # positions of the patterns whose object is stored
        self._detached = False

    def check_query(self) -> Pattern:
        """Return the checked query; raise QueryError if its result is no map of the property."""
        pattern = self.check(self.parsed.algebra)
        if self.property.subject != "voxel":
            raise self.error(
                f"STORE makes a map, but :{self.property.name} is a property of entities, not of "
                "voxels",
                self.parsed.store,
            )
        self._check_projection()
        if len(self.parsed.names) == 1:
            self._check_object(pattern)
        return pattern

    def result(self, table: Table, context: Context) -> StoreResult:
        """Return the statements of the solutions; QueryError where an entity has a wrong type."""
        names = [str(name) for name in self.parsed.names]
        object_name = names[1] if len(names) == 2 else STORED_OBJECT
        kind = self.property.object
        both = table.only([names[0], object_name])
        subject = both.columns.get(names[0]) or unbound("voxel", table.rows)
        object_ = both.columns.get(object_name) or unbound(kind, table.rows)
        # As in the template of an update, rows with an unbound variable are left out.
        rows = np.flatnonzero(subject.is_bound & object_.is_bound)
        rows = rows[np.lexsort((object_.values[rows], subject.values[rows]))]
        keys, values = subject.values[rows], object_.values[rows]
        new = np.ones(len(keys), np.bool_)
        new[1:] = (keys[1:] != keys[:-1]) | (values[1:] != values[:-1])
        keys, values = keys[new], values[new]
        size = self._catalogue.voxel_size
        if kind != "entity":
            stated = Statements(VoxelColumn(keys), Numbers(values.astype(np.float64)))
            return StoreResult(self.property, stated, None, size)
        used, codes = np.unique(values, return_inverse=True)
        entities = tuple(context.names.names[code] for code in used.tolist())
        for entity in entities:
            self._check_type(entity)
        stated = Statements(VoxelColumn(keys), Entities(codes.astype(np.int32), entities))
        about = entities[0] if len(entities) == 1 else None
        return StoreResult(self.property, stated, about, size)

    @contextmanager
    def detached(self) -> Iterator[None]:
        """Take no object from a part that binds no rows of the query."""
        before, self._detached = self._detached, True
        try:
            yield
        finally:
            self._detached = before

    def _triple(self, subject: Any, verb: Any, object_: Any) -> TriplePattern:
        triple = super()._triple(subject, verb, object_)
        matches = triple.subject == self._subject and triple.property == self.property
        if self._detached or not matches:
            return triple
        self._objects.append(position_of(verb) or 0)
        return replace(triple, object_variable=STORED_OBJECT)

    def _check_Union(self, node: Any) -> Pattern:
        before, self._objects = self._objects, []
        left = self.check(node.p1)
        of_left, self._objects = self._objects, []
        right = self.check(node.p2)
        of_right = self._objects
        if bool(of_left) != bool(of_right):
            raise self.error(
                f"STORE takes the object of :{self.property.name} here, but not from the other "
                "side of UNION: write the pattern on both sides, or outside of UNION",
                (of_left or of_right)[0],
            )
        self._objects = before + max(of_left, of_right, key=len)
        return Union(left, right)

    def _check_projection(self) -> None:
        names, property = self.parsed.names, self.property
        if EVERYTHING in map(str, names) or len(names) > 2:
            raise self.error(
                f"STORE needs SELECT with a voxel, or with a voxel and its {property.object}",
                self.parsed.store,
            )
        subject, *objects = names
        kind = self.kinds[str(subject)][0]
        if kind != "voxel":
            raise self.error(
                f"STORE needs a voxel first, and ?{subject} is {with_article(kind)}", subject
            )
        for each in objects:
            kind = self.kinds[str(each)][0]
            if kind != property.object:
                raise self.error(
                    f"the object of :{property.name} is {with_article(property.object)}, and "
                    f"?{each} is {with_article(kind)}",
                    each,
                )

    def _check_object(self, pattern: Pattern) -> None:
        """Refuse a query that gives a voxel no object, or several."""
        name, subject = self.property.name, self.parsed.names[0]
        if len(self._objects) > 1:
            raise self.error(
                f"?{subject} has several objects of :{name}: select the one to store, "
                f"SELECT ?{subject} ?object",
                sorted(self._objects)[1],
            )
        if not self._objects or STORED_OBJECT not in pattern.variables:
            raise self.error(
                f"STORE needs {with_article(self.property.object)} for each voxel: write a pattern "
                f"?{subject} :{name} ... in WHERE, outside of subqueries and groups, or select a "
                "second variable",
                self.parsed.store,
            )

    def _check_type(self, entity: str) -> None:
        try:
            self.schema.find_entities(entity, self.property.range)
        except (LookupError, TypeError) as error:
            raise self.error(str(error.args[0]), self.parsed.store) from error
