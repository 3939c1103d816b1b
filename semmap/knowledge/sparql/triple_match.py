"""The rows of a table that match a triple pattern."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import rdflib

from semmap.knowledge.mapping import DATATYPES, INFERRED_GRAPH, STATEMENTS
from semmap.knowledge.sparql.constants import tag_and_text
from semmap.knowledge.sparql.relation import Rows
from semmap.knowledge.sparql.scope import MapGraph, Part
from semmap.knowledge.sparql.values import (
    NUMBERED,
    Parameters,
    as_term,
    is_literal,
    number_of,
    same,
    text_of,
)
from semmap.knowledge.triple_map import LETTERS, Form, TripleMap, Value
from semmap.knowledge.vocabulary import decode

_IN_NO_EARLIER = (
    "NOT EXISTS (SELECT FROM triple d WHERE d.map_id = {a}.map_id "
    "AND d.predicate = {a}.predicate AND d.subject = {a}.subject AND d.object = {a}.object "
    "AND d.graph = ANY ({graphs}) AND d.id < {a}.id "
    "AND (d.until IS NULL OR d.until > statement_timestamp()))"
)
"""A union of graphs has a triple once."""


@dataclass
class MatchedPattern:
    """A triple pattern, and the triple maps that can match it."""

    subject: Part
    predicate: Part
    object: Part
    maps: list[TripleMap]

    def variables(self, triple: TripleMap) -> Iterator[tuple[str, Form]]:
        """Yield each variable, and the form that it has in a triple map."""
        forms = (triple.subject.form, "iri", triple.object.form)
        for part, form in zip((self.subject, self.predicate, self.object), forms, strict=True):
            if isinstance(part, str):
                yield part, form


class TripleMatch:
    """Matches triple patterns with triple maps."""

    def __init__(self, source: MapGraph) -> None:
        self.parameters = Parameters()
        self._chosen, self._inferred, self._fields = source.chosen, source.inferred, source.fields
        self._tbox, self._read_whole = source.tbox, source.pairs
        self.constants = source.constants
        self.namespace = self.parameters.bind(source.namespace)
        self.map_id = self.parameters.bind(source.map_id, "int")
        self._graph: Part | None = None

    def part(self, term: Any) -> Part:
        """Return a variable's name, or a constant."""
        if isinstance(term, rdflib.Variable):
            return str(term)
        if isinstance(term, rdflib.BNode):
            return f"_:{term}"
        return self.constant(term)

    def constant(self, term: Any, *, as_type: bool = False) -> Value:
        """Return a constant as it is kept in columns."""
        text, tag = tag_and_text(term)
        if tag != "I":
            return Value("term", self._bind(text), self._bind(tag), (text, tag))
        form, key = self.constants.node(text, as_type=as_type)
        type_ = {int: "bigint"}.get(type(key), "text")
        return Value(form, self.parameters.bind(key, type_), None, (text, "I"))

    def _bind(self, text: str) -> str:
        return self.parameters.bind(text)

    def fresh(self) -> str:
        """Return the name of a variable that no text has."""
        return self.parameters.alias("*")

    def _match(
        self, pattern: MatchedPattern, triple: TripleMap, aliases: dict[tuple[str, Part | str], str]
    ) -> Rows:
        """Return rows of a triple map that match; patterns share tables keyed by their subject."""
        letters: dict[str, str] = {}
        rows, source = Rows(), triple.source
        for letter, table in zip(LETTERS, source.tables, strict=False):
            key = None
            if not letters and source.key == triple.subject.sql:
                side = pattern.subject
                key = (table, side.sql if isinstance(side, Value) else side)
            if key is not None and key in aliases:
                letters[letter] = aliases[key]
                continue
            alias = letters[letter] = self.parameters.alias()
            if key is not None:
                aliases[key] = alias
            named = table.format(**letters)
            lateral = f"LATERAL {named}" if "(" in named else named
            rows.froms.append(lateral if " AS " in named else f"{lateral} {alias}")
        rows.where += [condition.format(**letters) for condition in source.where]
        if source.map_id is not None:
            rows.where.append(f"{source.map_id.format(**letters)} = {self.map_id}")
        subject, object_ = triple.subject.placed(letters), triple.object.placed(letters)
        for part, value in ((pattern.subject, subject), (pattern.object, object_)):
            if isinstance(part, str):
                rows.bind(part, value, self.namespace)
            else:
                constant = self._as_column(part, value)
                assert constant is not None
                rows.where.append(same(value, constant, self.namespace))
        if triple.nullable and isinstance(pattern.object, str):
            rows.where.append(f"{object_.sql} IS NOT NULL")
        self._match_verb(rows, pattern, triple, letters)
        if triple.property and triple.name == "{b}.key" and isinstance(pattern.object, Value):
            self._use_index_of_properties(rows, pattern, letters)
        for letter, table in zip(letters, source.tables, strict=True):
            if table == "triple":
                self._match_graph(rows, letters[letter], self._graph)
            elif table == "inference":
                self._match_inferred_graph(rows, f"{letters[letter]}.graph", self._graph)
        rows.where = list(dict.fromkeys(rows.where))
        return rows

    def _match_graph(self, rows: Rows, alias: str, graph: Part | None) -> None:
        if graph is None and self._chosen is None:
            rows.where.append(f"{alias}.graph = 0")
        elif graph is None:
            assert self._chosen is not None
            graphs = self._numbers(self._chosen.default)
            rows.where.append(f"{alias}.graph = ANY ({graphs})")
            if len(self._chosen.default) > 1:
                rows.where.append(_IN_NO_EARLIER.format(a=alias, graphs=graphs))
        elif isinstance(graph, Value):
            named_as = Value("resource", f"{alias}.graph")
            rows.where.append(same(named_as, self._name_of(graph), self.namespace))
            named = None if self._chosen is None else self._chosen.named
            if named is not None and graph.constant and graph.constant[0] not in named:
                rows.where.append("false")
        else:
            rows.where.append(f"{alias}.graph <> 0")
            if self._chosen is not None:
                rows.where.append(f"{alias}.graph = ANY ({self._numbers(self._chosen.named)})")
            rows.bind(graph, Value("resource", f"{alias}.graph"), self.namespace)

    def _name_of(self, graph: Value) -> Value:
        iri = graph if graph.form == "resource" else as_term(graph, self.namespace)
        return replace(iri, form="iri", tag=None) if iri.form == "term" else iri

    def _match_inferred_graph(self, rows: Rows, column: str, graph: Part | None) -> None:
        """The inferences of the map are a graph by themselves, others are in the named graphs."""
        chosen = self._chosen
        if graph is None:
            graphs = [INFERRED_GRAPH] if chosen is None else list(chosen.default)
            rows.where.append(f"{column} = ANY ({self.parameters.bind(graphs, 'text[]')})")
            return
        value = Value("iri", column)
        if isinstance(graph, str):
            rows.bind(graph, value, self.namespace)
        else:
            rows.where.append(same(value, self._name_of(graph), self.namespace))
        if chosen is not None:
            named = self.parameters.bind(list(chosen.named), "text[]")
            rows.where.append(f"{column} = ANY ({named})")

    def _numbers(self, iris: Iterable[str]) -> str:
        """Return the SQL of an array of the numbers of IRIs that statements have."""
        return (
            "ARRAY(SELECT term_id(n.iri) FROM "
            f"unnest({self.parameters.bind(list(iris), 'text[]')}) n (iri))"
        )

    def _match_verb(
        self, rows: Rows, pattern: MatchedPattern, triple: TripleMap, letters: Mapping[str, str]
    ) -> None:
        sql, name = triple.verb(letters)
        if triple in STATEMENTS:
            self._be(rows, pattern.predicate, Value("resource", sql))
        elif isinstance(pattern.predicate, str):
            sql = f"{sql}::text" if name is None else f"({sql})" if triple.property else sql
            rows.bind(pattern.predicate, Value("iri", sql), self.namespace)
        elif name is not None and pattern.predicate.constant:
            local = pattern.predicate.constant[0][len(triple.property) :]
            key = decode(local) if triple.property else local
            rows.where.append("false" if key is None else f"{name} = {self._bind(key)}")

    def _use_index_of_properties(
        self, rows: Rows, pattern: MatchedPattern, letters: Mapping[str, str]
    ) -> None:
        """Add a condition that the index on all properties answers."""
        assert isinstance(pattern.object, Value)
        if not isinstance(pattern.predicate, Value) or pattern.predicate.constant is None:
            return
        key = decode(pattern.predicate.constant[0].rsplit("#", 1)[-1])
        text, tag = pattern.object.constant or ("", "")
        kinds = {"string": "to_jsonb({v}::text)", "boolean": "to_jsonb({v}::boolean)"}
        kind = next((k for k in kinds if DATATYPES[k] == tag), None)
        if key is not None and kind is not None and (kind == "string" or text in ("true", "false")):
            value = kinds[kind].format(v=self._bind(text))
            rows.where.append(
                f"{letters['a']}.properties @> jsonb_build_object({self._bind(key)}, {value})"
            )

    def _as_column(self, constant: Value, column: Value) -> Value | None:
        """Return a constant in the form of a column; None where no row can have it."""
        form = column.form
        text, tag = constant.constant or ("", "I")
        if form == "iri" and column.sql.startswith("'") and column.sql != f"'{text}'::text":
            return None
        if form == "iri" and column.sql.startswith("('"):  # a computed name in a namespace
            namespace = column.sql[2:].partition("'")[0]
            return Value("iri", self._bind(text)) if text.startswith(namespace) else None
        if form in ("resource", "stored"):
            return self._as_number(constant, form)
        if form == constant.form and constant.tag is None:
            return constant
        if constant.form == "type" and form in ("term", "iri") and not column.sql.startswith("'"):
            # All IRIs of a type stand for that of its ontology, which statements have.
            tagged = self._bind(tag) if form == "term" else None
            return Value(form, text_of(constant, self.namespace), tagged)
        if form == "term":
            return Value("term", self._bind(text), self._bind(tag))
        if is_literal(form):
            if tag != DATATYPES[form]:
                return None
            if form in ("string", "gml", "geojson"):
                return Value(form, self._bind(text))
            # Terms are the same if they are written the same.
            return Value("term", self._bind(text), self._bind(tag))
        if form == "iri" and tag == "I" and constant.form != "entity":
            return Value("iri", self._bind(text))
        # Of an IRI that is a node of another kind, or none, no row is.
        return None

    def _as_number(self, constant: Value, form: Form) -> Value | None:
        """Return the number of a constant; None where no statement has it."""
        if constant.form in NUMBERED:
            return replace(constant, form=form)
        text, tag = constant.constant or ("", "")
        if tag != "I" and form == "resource":
            return None
        if constant.form == "type":  # all its IRIs stand for that of its ontology
            text = self.constants.class_of(self.constants.node(text, as_type=True)[1])
        elif self.constants.terms is not None:
            known = self.constants.terms.get((text, tag))
            return None if known is None else Value(form, self.parameters.bind(known, "bigint"))
        term = Value("term", self._bind(text), self._bind(tag), (text, tag))
        return Value(form, number_of(term, self.namespace))

    def _be(self, rows: Rows, part: Part, value: Value) -> None:
        """Let a side of a pattern be this value: a variable is bound, a constant must equal it."""
        if isinstance(part, Value):
            rows.where.append(self._equals(value, part))
        else:
            rows.bind(part, value, self.namespace)

    def _equals(self, value: Value, constant: Value) -> str:
        known = self._as_column(constant, value)
        return "false" if known is None else same(value, known, self.namespace)
