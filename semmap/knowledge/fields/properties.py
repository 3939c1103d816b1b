"""Properties of fields in a query, and the part of a query that fields answer.

Triples of a basic graph pattern with such properties, which are joined by their variables, become
one query of the language of fields. Its solutions are a table of the SQL of the rest.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import rdflib

from semmap.error import Error
from semmap.fields.store.names import read_map_vocabulary
from semmap.knowledge.mapping import COMPUTED, TRIPLES
from semmap.knowledge.sparql.constants import Constants
from semmap.knowledge.sparql.relation import Rows
from semmap.knowledge.sparql.values import Parameters
from semmap.knowledge.triple_map import Value
from semmap.knowledge.vocabulary import TYPE, decode, encode
from semmap.language.expression_checker import MIRRORED, conjuncts
from semmap.language.schema import Property, SideKind, with_article
from semmap.language.syntax_tree import nodes_in
from semmap.language.terms import local_name, number_of
from semmap.snake_case import snake_case

if TYPE_CHECKING:
    from semmap.knowledge.map_view import MapView


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
def _properties() -> Mapping[str, Property]:
    vocabulary = read_map_vocabulary()
    return {iri: p for p in vocabulary.properties for iri in (p.iri, *p.same_as)}


@cache
def _by_sql() -> frozenset[str]:
    """Return the properties that SQL answers: relations of surfaces, and columns."""
    return frozenset(t.property for t in TRIPLES if t.name is None) | {c.property for c in COMPUTED}


def field_property(iri: str) -> Property | None:
    """Return the property of fields that an IRI names; None where fields have none."""
    return _properties().get(iri)


def property_iris() -> frozenset[str]:
    """Return the IRIs of the properties of fields."""
    return frozenset(_properties())


def is_of_fields(iri: str) -> bool:
    """Return whether fields alone state a property: sees, but neither on nor probability."""
    return iri in _properties() and iri not in _by_sql()


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


_ENTITIES = (
    "SELECT name, id FROM entity WHERE map_id = (SELECT current_map()) AND name = ANY (%(n)s)"
)
_TYPES = "SELECT name, iri FROM semantic_type WHERE name = ANY (%(n)s)"
_WORDS = "SELECT name, label FROM semantic_type"


@dataclass(eq=False)
class FieldRows:
    """Asks fields, and states their answers as rows."""

    view: MapView  # gets the text of each question, and what an answer says nothing of

    def rows(
        self,
        triples: Iterable[tuple[str | Value, Any, str | Value]],
        constants: Constants,
        parameters: Parameters,
        is_needed: Callable[[str, int], bool],
        conditions: Collection[tuple[str, str, str]],
    ) -> tuple[list[Rows], dict[str, Value]]:
        """Return rows for each group of triples that variables join, and constants of some.

        `is_needed` says whether a variable that occurs so often in a group is needed elsewhere; all
        solutions will meet the conditions. The constants are those that variables of rows must
        have.
        """
        equal: dict[str, Value] = {}

        def side(part: str | Value) -> str | tuple[str, ...]:
            if isinstance(part, str):
                return part
            text = self._constant(part)
            if text is not None:
                return (text,)
            name = parameters.alias("*c")
            equal[name] = part
            return name

        stated = []
        for subject, predicate, object_ in triples:
            property_ = field_property(constants.property(str(predicate)))
            assert property_ is not None
            stated.append(FieldTriple(side(subject), property_, side(object_), predicate))
        found = []
        for group in components(stated):
            counts: dict[str, int] = {}
            for triple in group:
                for name, _ in triple.variables():
                    counts[name] = counts.get(name, 0) + 1
            kept = {name for name, count in counts.items() if is_needed(name, count)}
            query = FieldQuery.of(group, kept, conditions)
            found.append(self._solutions(query, parameters))
        return found, equal

    def _constant(self, value: Value) -> str | None:
        """Return a constant as fields write it; None where it names an entity and a type."""
        text, tag = value.constant or ("", "I")
        if tag != "I":
            number = rdflib.Literal(text, datatype=rdflib.URIRef(tag)).value
            is_number = isinstance(number, (int, float)) and not isinstance(number, bool)
            return str(rdflib.Literal(number if is_number else text).n3())
        if value.form == "voxel":
            return None
        if text.startswith(self.view.namespace):
            name = decode(text[len(self.view.namespace) :]) or text
            if value.form == "entity" and snake_case(name) in self._words:
                return None
        else:
            name = local_name(text)
        return str(rdflib.Literal(name).n3())

    @cached_property
    def _words(self) -> frozenset[str]:
        rows = self.view.session.execute(_WORDS)
        return frozenset(snake_case(word) for row in rows for word in row if word)

    def _solutions(self, query: FieldQuery, parameters: Parameters) -> Rows:
        from semmap.knowledge.fields.map_fields import ask_fields  # slow to import

        answer = ask_fields(self.view.session, self.view.name, query)
        self.view.statements.append(
            f"fields: {query.text}\n-- {len(answer.rows)} rows, by {answer.by}"
        )
        if answer.left_out:
            shown = ", ".join(answer.left_out[:5]) + (", ..." if len(answer.left_out) > 5 else "")
            self.view.notes.append(
                f"unknown, as they have no voxels: {len(answer.left_out)} entities: {shown}"
            )
        alias = parameters.alias("f")
        arrays, rows = [], Rows()
        for number, (name, kind) in enumerate(zip(query.names, query.kinds, strict=True)):
            values, form, type_ = self._column(answer, number, kind)
            arrays.append(parameters.bind(values, f"{type_}[]"))
            tag = "'I'::text" if form == "term" else None
            rows.variables[name] = Value(form, f"{alias}.c{number}", tag)
        if query.counts:
            arrays.append(parameters.bind([row[-1] for row in answer.rows], "bigint[]"))
        columns = ", ".join(f"c{i}" for i in range(len(arrays)))
        rows.froms.append(f"unnest({', '.join(arrays)}) {alias} ({columns})")
        if query.counts:  # a solution as often as fields have it
            again = parameters.alias("n")
            rows.froms.append(f"LATERAL generate_series(1, {alias}.c{len(arrays) - 1}) {again}")
        return rows

    def _column(self, answer: FieldAnswer, number: int, kind: str) -> tuple[list[Any], str, str]:
        """Return the values of a column, their form, and the type of SQL."""
        values = [row[number] for row in answer.rows]
        if kind == "number":
            return values, "double", "double precision"
        if kind == "voxel":
            size = answer.voxel_size
            keys = [",".join(str(math.floor(x / size)) for x in centre) for centre in values]
            return keys, "voxel", "text"
        names = sorted(set(values))
        entities: dict[str, int] = dict(self.view.session.execute(_ENTITIES, {"n": names}))
        if len(entities) == len(names):
            return [entities[name] for name in values], "entity", "bigint"
        # What sources name, and the map does not have: types of detectors, agents.
        types: dict[str, str | None] = dict(self.view.session.execute(_TYPES, {"n": names}))
        iris = {
            name: types[name] or f"{TYPE}{encode(name)}"
            if name in types and name not in entities
            else f"{self.view.namespace}{encode(name)}"
            for name in names
        }
        return [iris[name] for name in values], "term", "text"
