"""Questions to a catalogue of fields, and their answers."""

from __future__ import annotations

import builtins
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import rdflib
from numpy.typing import NDArray

from semmap.language.checker import TAKEN, Checker
from semmap.fields.queries.evaluate import evaluate
from semmap.language.expressions import centres, word
from semmap.language.grammar import EVERYTHING, TOO_DEEP, Parsed, parse_query
from semmap.language.plan import Context
from semmap.fields.queries.table import Column, ColumnKind, LimitError, Table, unbound
from semmap.language.property import Property
from semmap.fields.queries.statements import (
    Catalogue,
    Numbers,
    Relation,
    Statements,
    Things,
    Voxels,
    voxels_of_keys,
)

__all__ = ["Rows", "Stored", "query"]


@dataclass(frozen=True, eq=False)
class Rows:
    """The answer to SELECT, in order; iteration gives tuples.

    A voxel comes as its centre (x, y, z) in metres, a thing by name, a number as it is, and None
    where a variable is not bound.
    """

    names: tuple[str, ...]
    columns: tuple[Column, ...]
    count: int
    things: tuple[str, ...]
    voxel_size: float

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[tuple[Any, ...]]:
        if not self.columns:
            return iter([()] * self.count)
        return iter(zip(*(self._plain(column) for column in self.columns), strict=True))

    def column(self, name: str) -> Column:
        """The column of a variable; KeyError if it was not asked for."""
        if name not in self.names:
            raise KeyError(f"?{name} is not one of {', '.join(f'?{n}' for n in self.names)}")
        return self.columns[self.names.index(name)]

    def voxels(self, name: str) -> NDArray[np.int32]:
        """(N, 3) the voxels of a variable, in the order of the rows that bind it."""
        column = self.column(name)
        if column.kind != "voxel":
            raise TypeError(f"?{name} is {word(column.kind)}, not a voxel")
        return voxels_of_keys(column.values[column.there])

    def json(self) -> dict[str, Any]:
        """Names, and rows as lists, for `json.dumps`."""
        return {"variables": list(self.names), "rows": [list(row) for row in self]}

    def _plain(self, column: Column) -> list[Any]:
        values: list[Any]
        if column.kind == "voxel":
            points = centres(column.values, self.voxel_size)
            values = [tuple(point) for point in points.tolist()]
        elif column.kind in ("thing", "text"):
            values = [self.things[code] if self.things else "" for code in column.values.tolist()]
        else:
            values = column.values.tolist()
        if column.bound is None:
            return values
        return [v if b else None for v, b in zip(values, column.bound.tolist(), strict=True)]


@dataclass(frozen=True, eq=False)
class Stored:
    """The answer to STORE: what a new map states.

    Attributes
    ----------
    property : what it says
    statements : a voxel and its thing or number in each row; none twice, and in ascending order
    about : the thing, where all rows have the same
    """

    property: Property
    statements: Statements
    about: str | None
    voxel_size: float

    def __len__(self) -> int:
        return len(self.statements.subject)

    @builtins.property
    def voxels(self) -> NDArray[np.int32]:
        """(N, 3) the voxels of the rows."""
        assert isinstance(self.statements.subject, Voxels)
        return voxels_of_keys(self.statements.subject.keys)


def query(catalogue: Catalogue, text: str, now: datetime | None = None) -> Rows | Stored | bool:
    """What a catalogue says to a query: rows to SELECT, a map to STORE, True or False to ASK.

    Parameters
    ----------
    catalogue : Catalogue
    text : str
        SPARQL with the clauses of `docs/fields_language.md`, or as the paper has it (reMap,
        section 4).
    now : datetime, optional
        Of which DURING counts back; aware.

    Raises
    ------
    QueryError
        With the place in the text: no SPARQL, an unknown property or name, kinds that do not fit.
    """
    parsed = parse_query(text)
    try:
        return _answer(parsed, _then(parsed, catalogue, now))
    except LimitError as error:
        raise parsed.error(str(error), 0) from None
    except RecursionError:
        raise parsed.error(TOO_DEEP, 0) from None


def _answer(parsed: Parsed, catalogue: Catalogue) -> Rows | Stored | bool:
    store = None if parsed.store is None else Checker(parsed, catalogue).relation(parsed.store)
    taking = store if len(parsed.names) == 1 else None
    checker = Checker(parsed, catalogue, store=taking, subject=str(next(iter(parsed.names), "")))
    plan = checker.plan(parsed.algebra)
    if store is not None:
        _check_store(parsed, checker, store, plan.variables)
    context = Context(catalogue.voxel_size)
    table = evaluate(plan, context)
    if parsed.form == "AskQuery":
        return table.rows > 0
    names = [str(name) for name in parsed.names]
    if names == [EVERYTHING]:
        names = checker.everything(plan)
    if store is not None:
        return _stored(parsed, catalogue, checker, store.property, table, context)
    columns = tuple(
        table.columns.get(name) or unbound(checker.kinds[name][0], table.rows) for name in names
    )
    return Rows(tuple(names), columns, table.rows, tuple(context.names.names), catalogue.voxel_size)


def _then(parsed: Parsed, catalogue: Catalogue, now: datetime | None) -> Catalogue:
    """The catalogue as AT or DURING wants it."""
    try:
        if parsed.moment is not None:
            return catalogue.at(_moment(parsed, parsed.moment))
        if len(parsed.span) == 2:
            begin, end = (_moment(parsed, each) for each in parsed.span)
            if end < begin:
                raise parsed.error("this is before the beginning: turn them round", parsed.span[1])
            return catalogue.during(begin, end)
        if parsed.span:
            end = datetime.now(UTC) if now is None else now
            return catalogue.during(end - _duration(parsed, parsed.span[0]), end)
    except LookupError as error:
        at = parsed.moment if parsed.moment is not None else parsed.span[0]
        raise parsed.error(str(error.args[0] if error.args else error), at) from error
    return catalogue


def _moment(parsed: Parsed, literal: Any) -> datetime:
    value = literal.value
    if literal.datatype != rdflib.XSD.dateTime or not isinstance(value, datetime):
        raise parsed.error('no time: write "2026-01-31T12:00:00Z"^^xsd:dateTime', literal)
    if value.tzinfo is None:
        raise parsed.error(f'this time has no zone: for UTC write "{literal}Z"', literal)
    return value


def _duration(parsed: Parsed, literal: Any) -> timedelta:
    value = literal.value
    kinds = (rdflib.XSD.duration, rdflib.XSD.dayTimeDuration)
    if literal.datatype not in kinds or not isinstance(value, timedelta):
        raise parsed.error(
            'no duration: write "PT10S"^^xsd:duration, or two times of xsd:dateTime', literal
        )
    if value < timedelta(0):
        raise parsed.error("a duration has to be at least 0: it counts back from now", literal)
    return value


def _check_store(
    parsed: Parsed, checker: Checker, store: Relation, variables: frozenset[str]
) -> None:
    """Refuse what would be no map of the property."""
    about, iri = store.property, parsed.store
    if about.subject != "voxel":
        raise parsed.error(f"STORE makes a map, and :{about.name} is of things, not of voxels", iri)
    if EVERYTHING in map(str, parsed.names) or len(parsed.names) > 2:
        raise parsed.error(
            f"STORE takes SELECT with a voxel, or with a voxel and its {about.object}", iri
        )
    subject, *objects = parsed.names
    kind = checker.kinds[str(subject)][0]
    if kind != "voxel":
        raise parsed.error(f"STORE takes a voxel first, and ?{subject} is {word(kind)}", subject)
    for each in objects:
        kind = checker.kinds[str(each)][0]
        if kind != about.object:
            raise parsed.error(
                f"the object of :{about.name} is {word(about.object)}, and ?{each} is {word(kind)}",
                each,
            )
    if objects:
        return
    if len(checker.taken) > 1:
        raise parsed.error(
            f"a second object of :{about.name} for ?{subject}: project the one that is meant, "
            f"SELECT ?{subject} ?object", sorted(checker.taken)[1],
        )  # fmt: skip
    if not checker.taken or TAKEN not in variables:
        raise parsed.error(
            f"nothing tells which {about.object} each voxel gets: WHERE needs a pattern "
            f"?{subject} :{about.name} ..., outside of subqueries and groups, or a second variable "
            "after SELECT", iri,
        )  # fmt: skip


def _stored(
    parsed: Parsed,
    catalogue: Catalogue,
    checker: Checker,
    about: Property,
    table: Table,
    context: Context,
) -> Stored:
    names = [str(name) for name in parsed.names]
    object_name = names[1] if len(names) == 2 else TAKEN
    both = table.only([names[0], object_name])
    kind: ColumnKind = "thing" if about.object == "thing" else "number"
    subject = both.columns.get(names[0]) or unbound("voxel", table.rows)
    object_ = both.columns.get(object_name) or unbound(kind, table.rows)
    there = subject.there & object_.there  # as a template leaves out what is not bound
    order = np.flatnonzero(there)
    order = order[np.lexsort((object_.values[order], subject.values[order]))]
    keys, values = subject.values[order], object_.values[order]
    new = np.ones(len(keys), np.bool_)
    new[1:] = (keys[1:] != keys[:-1]) | (values[1:] != values[:-1])
    keys, values = keys[new], values[new]
    if about.object != "thing":
        stated = Statements(Voxels(keys), Numbers(values.astype(np.float64)))
        return Stored(about, stated, None, catalogue.voxel_size)
    used, codes = np.unique(values, return_inverse=True)
    things = tuple(context.names.names[code] for code in used.tolist())
    for thing in things:
        try:
            catalogue.things(thing, about.range)
        except (LookupError, TypeError) as error:
            raise parsed.error(str(error.args[0]), parsed.store) from error
    stated = Statements(Voxels(keys), Things(codes.astype(np.int32), things))
    return Stored(about, stated, things[0] if len(things) == 1 else None, catalogue.voxel_size)
