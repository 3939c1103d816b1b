"""Properties of fields in a query, and the part of a query that fields answer.

Triples of a basic graph pattern with such properties, which are joined by their variables, become
one query of the language of fields. Its solutions are a table of the SQL of the rest.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import rdflib

from semmap.error import Error
from semmap.fields.store.names import read_map_vocabulary
from semmap.knowledge.mapping import COMPUTED, TRIPLES
from semmap.language.expression_checker import MIRRORED, conjuncts
from semmap.language.schema import Property, SideKind, with_article
from semmap.language.syntax_tree import nodes_in
from semmap.language.terms import number_of


class FieldError(Error, ValueError):
    """Fields cannot answer their part of a query: why, and the term of the query it is about."""

    def __init__(self, reason: str, place: Any) -> None:
        super().__init__(reason)
        self.reason, self.place = reason, place


FieldPart = str | tuple[str, ...]
"""A side of a triple: the name of a variable, or a constant in the language of fields."""


@dataclass(frozen=True)
class FieldTriple:
    """A triple whose property fields state."""

    # subject, object: the name of a variable, or (text,) of a constant as fields write it
    subject: FieldPart
    property: Property  # what states it
    object: FieldPart
    place: Any = None  # the term of the query

    def variables(self) -> Iterator[tuple[str, SideKind]]:
        """Yield the variables with what they stand for: a voxel, an entity or a number."""
        if isinstance(self.subject, str):
            yield self.subject, self.property.subject
        if isinstance(self.object, str):
            yield self.object, self.property.object


@dataclass(frozen=True)
class FieldQuery:
    """A query that fields answer."""

    text: str  # in the language of fields; its columns are ?v0, ?v1, ..., and ?n if it counts
    names: tuple[str, ...]  # the variable of each column
    kinds: tuple[str, ...]  # what each stands for: "voxel", "entity" or "number"
    counts: bool  # the last column is how many solutions have these values
    place: Any  # the term of the query

    @classmethod
    def of(
        cls,
        triples: Collection[FieldTriple],
        kept: Collection[str],
        conditions: Iterable[tuple[str, str, str]] = (),
    ) -> FieldQuery:
        """Return the query of triples for the variables `kept`; all solutions meet conditions."""
        place = next(iter(triples)).place
        kinds: dict[str, SideKind] = {}
        for triple in triples:
            for name, kind in triple.variables():
                if kinds.setdefault(name, kind) != kind:
                    both = f"{with_article(kinds[name])} and {with_article(kind)}"
                    raise FieldError(f"?{name} is {both}: use two variables", triple.place)
        short = {name: f"?v{i}" for i, name in enumerate(kinds)}

        def side(part: FieldPart) -> str:
            return short[part] if isinstance(part, str) else part[0]

        lines = [f"{side(t.subject)} <{t.property.iri}> {side(t.object)} ." for t in triples]
        lines += [
            f"FILTER({short[name]} {operator} {number})"
            for name, operator, number in conditions
            if kinds.get(name) == "number"
        ]
        columns = [name for name in kinds if name in kept]
        counts = not columns or len(columns) < len(kinds)
        shown = " ".join(short[name] for name in columns)
        body = f"WHERE {{ {' '.join(lines)} }}"
        text = f"SELECT {shown} {body}"
        if counts:
            grouped = f" GROUP BY {shown}" if columns else ""
            text = f"SELECT {shown} (COUNT(*) AS ?n) {body}{grouped}"
        return cls(text, tuple(columns), tuple(kinds[n] for n in columns), counts, place)


@dataclass(frozen=True)
class FieldAnswer:
    """The answer of fields."""

    # a value for each column: a voxel is the (x, y, z) of its centre, an entity its name
    rows: list[tuple[Any, ...]]
    voxel_size: float  # metres
    by: str  # what answered
    left_out: tuple[str, ...] = ()  # entities without voxels, of which the answer says nothing


@cache
def field_properties() -> Mapping[str, Property]:
    """Return the properties of fields by the IRIs that name them."""
    vocabulary = read_map_vocabulary()
    return {iri: p for p in vocabulary.properties for iri in (p.iri, *p.same_as)}


@cache
def _by_sql() -> frozenset[str]:
    """Return the properties that SQL answers: relations of surfaces, and columns."""
    return frozenset(t.property for t in TRIPLES if t.name is None) | {c.property for c in COMPUTED}


def is_of_fields(iri: str) -> bool:
    """Return whether fields alone state a property: sees, but neither on nor probability."""
    return iri in field_properties() and iri not in _by_sql()


def is_of_voxels(iri: str) -> bool:
    """Return whether fields state a property of voxels; of entities, tables may state it."""
    found = field_properties().get(iri)
    return found is not None and found.subject == "voxel"


def components(triples: Iterable[FieldTriple]) -> list[list[FieldTriple]]:
    """Return triples by groups that share no variable."""
    groups: list[tuple[set[str], list[FieldTriple]]] = []
    for triple in triples:
        names = {name for name, _ in triple.variables()}
        joined = [group for group in groups if group[0] & names]
        merged = (names.union(*(g[0] for g in joined)), [t for g in joined for t in g[1]])
        groups = [g for g in groups if g not in joined] + [(merged[0], [*merged[1], triple])]
    return [group for _, group in groups]


def count_variables(tree: Any) -> Counter[str]:
    """Return how often each variable and blank node occurs in a part of the algebra."""
    ends = (each for each in nodes_in(tree) if isinstance(each, (rdflib.Variable, rdflib.BNode)))
    return Counter(str(e) if isinstance(e, rdflib.Variable) else f"_:{e}" for e in ends)


def comparisons(tree: Any) -> Iterator[tuple[str, str, str]]:
    """Yield variable, operator and number of the comparisons that a condition consists of.

    >>> from semmap.language.parser import parse_query
    >>> text = 'ASK { ?v :distanceToPerson ?d FILTER(2 > ?d && ?d < "INF"^^xsd:double) }'
    >>> list(comparisons(parse_query(text).algebra.p.expr))
    [('d', '<', '2.0')]
    """
    for part in conjuncts(tree):
        if getattr(part, "name", "") != "RelationalExpression" or part.op not in MIRRORED:
            continue
        left, operator, right = part.expr, str(part.op), part.other
        if isinstance(right, rdflib.Variable):
            left, operator, right = right, MIRRORED[operator], left
        number = number_of(right)
        if isinstance(left, rdflib.Variable) and number is not None and math.isfinite(number):
            yield str(left), operator, repr(number)
