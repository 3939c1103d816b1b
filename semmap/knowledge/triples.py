"""Triple patterns and property paths as rows of the tables that the mapping names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import rdflib
from rdflib.paths import AlternativePath, InvPath, MulPath, NegatedPath, SequencePath

from semmap.knowledge.constants import Constants, tag_and_text
from semmap.knowledge.expressions import UntranslatedError
from semmap.knowledge.field_rows import FieldRows
from semmap.knowledge.fields import field_property, is_of_fields
from semmap.knowledge.mapping import (
    COMPUTED,
    DATATYPES,
    INFERENCES,
    INFERRED_GRAPH,
    NODES,
    REWRITTEN,
    STATEMENTS,
    TRIPLES,
    Column,
    Computed,
    Form,
    TripleMap,
    is_mapped,
)
from semmap.knowledge.relation import UNBOUND, Rows, can_join, in_form, union, union_form
from semmap.knowledge.values import Parameters, Value, as_term, is_literal, key_of, same, text_of
from semmap.knowledge.vocabulary import RDF, decode

__all__ = ["NOTHING_INFERRED", "Chosen", "Inferred", "Scope", "TriplePatterns"]

_RDF_TYPE = f"{RDF}type"
_COMPUTED = {each.property: each for each in COMPUTED}
_KEYS = {t.source.tables[0][1]: t.source.key for t in TRIPLES if t.source.key is not None}
"""The column of a table that is unique."""
_PLAIN = re.compile(r"[a-z_]+ t\d+")
_SAME_KEY = re.compile(r"(t\d+)\.([a-z_]+) = (t\d+)\.\2")
_IN_NO_EARLIER = (
    "NOT EXISTS (SELECT FROM statement d WHERE d.map_id = {a}.map_id "
    "AND d.predicate = {a}.predicate AND d.graph = ANY ({graphs}) AND d.id < {a}.id "
    "AND (d.until IS NULL OR d.until > statement_timestamp()) "
    "AND (d.subject_id, d.subject, d.object_id, d.object, d.tag) "
    "IS NOT DISTINCT FROM ({a}.subject_id, {a}.subject, {a}.object_id, {a}.object, {a}.tag))"
)
"""A union of graphs has a triple once."""

Part = str | Value
"""A variable by its name, or a constant."""


@dataclass(frozen=True)
class Chosen:
    """The graphs that FROM or USING choose (SPARQL 1.1, section 13.2): the map is not in them.

    Attributes
    ----------
    default : IRIs; the default graph is the union of these graphs
    named : IRIs of the graphs that GRAPH finds
    """

    default: tuple[str, ...] = ()
    named: tuple[str, ...] = ()

    @classmethod
    def by(cls, clauses: Iterable[Any] | None) -> Chosen | None:
        """Return what the clauses of a text choose; None where there are none."""
        clauses = list(clauses or ())
        if not clauses:
            return None
        return cls(
            tuple(str(each.default) for each in clauses if each.default is not None),
            tuple(str(each.named) for each in clauses if each.named is not None),
        )


@dataclass(frozen=True)
class Inferred:
    """What inferences a map has, so that patterns look for no others.

    Attributes
    ----------
    properties : of inferences
    classes, types : that are inferred, as IRIs, and as names of semantic types
    """

    properties: frozenset[str] = frozenset()
    classes: frozenset[str] = frozenset()
    types: frozenset[str] = frozenset()


NOTHING_INFERRED = Inferred()


@dataclass(frozen=True)
class Scope:
    """Where a pattern stands.

    Attributes
    ----------
    graph : the graph that GRAPH names, a constant or a variable; None for the default graph
    bindings : values that the solutions will be joined with: a pattern need not have others, and
        may refer to them
    outer : for EXISTS, the values that expressions see besides those of the pattern
    conditions : variable, operator and number of comparisons that all solutions will meet
    given : bindings of few rows: each table is limited to them by its index
    """

    graph: Part | None = None
    bindings: Mapping[str, Value] = field(default_factory=dict)
    outer: Mapping[str, Value] = field(default_factory=dict)
    conditions: tuple[tuple[str, str, str], ...] = ()
    given: Mapping[str, Value] = field(default_factory=dict)

    def joined(self, bindings: Mapping[str, Value]) -> Scope:
        """Return the scope of a pattern that is joined with more values."""
        return replace(self, bindings={**self.bindings, **bindings})


@dataclass
class _Pattern:
    """A triple pattern, and the triple maps that can match it."""

    subject: Part
    predicate: Part
    object: Part
    maps: list[TripleMap]

    def sides(self, triple: TripleMap) -> Iterable[tuple[Part, Form]]:
        yield self.subject, triple.subject.form
        yield self.predicate, "iri"
        yield self.object, triple.object.form


class TriplePatterns:
    """Translates triple patterns.

    Parameters
    ----------
    constants : what the IRIs of the text stand for
    namespace : of the map's entities
    map_id : the map
    chosen : the graphs to read; None for the map and all graphs
    fields : answers what fields state
    uses : how often each variable occurs in the whole query
    inferred : the inferences that patterns match, too
    """

    def __init__(
        self,
        constants: Constants,
        namespace: str,
        map_id: int,
        chosen: Chosen | None = None,
        fields: FieldRows | None = None,
        uses: Mapping[str, int] | None = None,
        inferred: Inferred = NOTHING_INFERRED,
    ) -> None:
        self._inferred = inferred
        self.fields = fields
        self.uses = uses or {}
        self.parameters = Parameters()
        self._chosen = chosen
        self.constants = constants
        self.namespace = self.parameters.bind(namespace)
        self.map_id = self.parameters.bind(map_id, "int")
        self._graph: Part | None = None

    # Terms

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

    # Basic graph patterns

    def sources(self, triple: tuple[Any, Any, Any], graph: Any) -> list[TripleMap] | Computed:
        """Return what can match a triple pattern: triple maps, or the relation that it computes.

        Parameters
        ----------
        graph : the term after GRAPH; None for the default graph

        Raises
        ------
        UntranslatedError
            Fields state the property.
        """
        subject, predicate, object_ = triple
        scope = Scope(None if graph is None else self.part(graph))
        if isinstance(predicate, rdflib.URIRef):
            computed = self._computed(predicate, scope)
            if computed is not None:
                return computed  # type: ignore[no-any-return]
        if self._is_of_fields(predicate, scope) or self._may_be_of_fields(predicate, scope):
            raise UntranslatedError("fields state this", predicate)
        end = self.part(object_)
        if str(predicate) == _RDF_TYPE and isinstance(end, Value):
            end = self.constant(object_, as_type=True)
        verb = self.part(predicate)
        if isinstance(verb, Value):
            verb = self._verb(predicate)
        start = self.part(subject)
        return [m for m in self._maps(verb, scope) if self._fits(start, verb, end, m, scope)]

    def triples(self, triples: Iterable[tuple[Any, Any, Any]], scope: Scope) -> Rows:
        """Return the solutions of triple patterns that must all match."""
        outside, self._graph = self._graph, scope.graph
        try:
            return self._all_triples(triples, scope)
        finally:
            self._graph = outside

    def _all_triples(self, triples: Iterable[tuple[Any, Any, Any]], scope: Scope) -> Rows:
        plain: list[_Pattern] = []
        paths: list[tuple[Part, MulPath, Part]] = []
        computed: list[tuple[Part, Computed, Part]] = []
        stated: list[tuple[Part, Any, Part]] = []
        either: list[tuple[Part, Any, Part]] = []
        parts: list[list[Rows]] = []

        def add(subject: Part, predicate: Any, object_: Part) -> None:
            if isinstance(predicate, InvPath):
                add(object_, predicate.arg, subject)
            elif isinstance(predicate, SequencePath):
                stops = [subject, *(self.fresh() for _ in predicate.args[1:]), object_]
                for start, step, end in zip(stops, predicate.args, stops[1:], strict=False):
                    add(start, step, end)
            elif isinstance(predicate, AlternativePath):
                parts.append([self._one(subject, step, object_, scope) for step in predicate.args])
            elif isinstance(predicate, NegatedPath):
                parts.append(list(self._negated(subject, predicate, object_, scope)))
            elif isinstance(predicate, MulPath):
                paths.append((subject, predicate, object_))
            elif isinstance(predicate, rdflib.URIRef) and self._computed(predicate, scope):
                computed.append((subject, self._computed(predicate, scope), object_))
            elif self._is_of_fields(predicate, scope):
                stated.append((subject, predicate, object_))
            elif self._may_be_of_fields(predicate, scope):
                either.append((subject, predicate, object_))
            else:
                add_fact(subject, predicate, object_)

        def add_fact(subject: Part, predicate: Any, object_: Part) -> None:
            verb = self.part(predicate)
            if isinstance(verb, Value):
                verb = self._verb(predicate)
            maps = [
                m for m in self._maps(verb, scope) if self._fits(subject, verb, object_, m, scope)
            ]
            plain.append(_Pattern(subject, verb, object_, maps))

        for subject, predicate, object_ in triples:
            end = self.part(object_)
            if str(predicate) == _RDF_TYPE and isinstance(end, Value):
                end = self.constant(object_, as_type=True)
            add(self.part(subject), predicate, end)
        voxels = {subject for subject, verb, _ in stated if self._field(verb).subject == "voxel"}
        for subject, predicate, object_ in either:
            if subject in voxels:
                stated.append((subject, predicate, object_))
            else:
                add_fact(subject, predicate, object_)
        self._prune(plain, scope)
        rows = self._joined(plain, scope)
        if stated:
            self._join_fields(rows, stated, scope)
        for part in parts:
            rows.join(union(part, self.parameters, self.namespace), self.namespace)
        for start, path, end in paths:
            self._walk(rows, start, path, end, scope)
        for a, relation, b in computed:
            self._relate(rows, a, relation, b, scope)
        return rows

    def _one(self, subject: Part, predicate: Any, object_: Part, scope: Scope) -> Rows:
        """Return the solutions of one pattern whose sides are parts already."""
        rows = self.triples(
            [(rdflib.Variable("*s"), predicate, rdflib.Variable("*o"))], self._inside(scope)
        )
        return self._renamed(rows, {"*s": subject, "*o": object_})

    def _inside(self, scope: Scope) -> Scope:
        return replace(scope, bindings={})

    def _renamed(self, rows: Rows, names: Mapping[str, Part]) -> Rows:
        """Return rows with other names for some variables, or a constant for them."""
        found = Rows(rows.froms, list(rows.where))
        for name, value in rows.variables.items():
            part = names.get(name, name)
            if isinstance(part, Value):
                found.where.append(self._equals(value, part))
            else:
                found.bind(part, value, self.namespace)
        return found

    def _verb(self, iri: Any) -> Value:
        text = self.constants.property(str(iri))
        return Value("iri", self._bind(text), None, (text, "I"))

    # Properties of fields

    def _field(self, iri: Any) -> Any:
        return field_property(self.constants.property(str(iri)))

    def _is_of_fields(self, predicate: Any, scope: Scope) -> bool:
        iri = isinstance(predicate, rdflib.URIRef) and self.constants.property(str(predicate))
        return self._is_map(scope) and bool(iri) and is_of_fields(str(iri))

    def _may_be_of_fields(self, predicate: Any, scope: Scope) -> bool:
        """Return whether a property is one of voxels and, of other subjects, one of tables."""
        iri = isinstance(predicate, rdflib.URIRef)
        found = self._field(predicate) if iri and self._is_map(scope) else None
        return found is not None and found.subject == "voxel"

    def _join_fields(self, rows: Rows, stated: list[tuple[Part, Any, Part]], scope: Scope) -> None:
        """Join what fields answer; variables that nothing else needs are counted there."""
        if self.fields is None:
            raise UntranslatedError("fields cannot be asked here", stated[0][1])

        def is_needed(name: str, count: int) -> bool:
            return name.startswith("*") or self.uses.get(name, 0) > count

        found, equal = self.fields.rows(
            stated, self.constants, self.parameters, is_needed, scope.conditions
        )
        for part in found:
            for name in part.variables.keys() & equal.keys():
                part.where.append(self._equals(part.variables.pop(name), equal[name]))
            rows.join(part, self.namespace)

    def _computed(self, iri: Any, scope: Scope) -> Any:
        if not self._is_map(scope):
            return None
        return _COMPUTED.get(self.constants.property(str(iri)))

    def _is_map(self, scope: Scope) -> bool:
        """Return whether a pattern reads the map, and not only statements of chosen graphs."""
        return scope.graph is None and self._chosen is None

    def _maps(self, verb: Part, scope: Scope) -> Iterable[TripleMap]:
        """Yield the triple maps of a property; all facts for a variable."""
        if not self._is_map(scope):
            if not _is_inferred_graph(scope.graph):
                yield from STATEMENTS
            if self._reads_inferences(scope):
                yield from self._inferences(verb)
            return
        yield from self._inferences(verb)
        if isinstance(verb, str):
            yield from TRIPLES
            yield from STATEMENTS
            return
        iri, _ = verb.constant or ("", "")
        for triple in (*TRIPLES, *REWRITTEN):
            if triple.property == iri if triple.name is None else iri.startswith(triple.property):
                yield triple
        if not is_mapped(iri):
            yield from STATEMENTS

    def _reads_inferences(self, scope: Scope) -> bool:
        """Return whether graphs that a pattern reads have the inferences among them."""
        if self._chosen is None:
            return isinstance(scope.graph, str) or _is_inferred_graph(scope.graph)
        chosen = self._chosen.default if scope.graph is None else self._chosen.named
        named = isinstance(scope.graph, Value) and not _is_inferred_graph(scope.graph)
        return INFERRED_GRAPH in chosen and not named

    def _inferences(self, verb: Part) -> Iterable[TripleMap]:
        known = self._inferred.properties
        if known and (isinstance(verb, str) or (verb.constant or ("",))[0] in known):
            yield from INFERENCES

    def _fits(
        self, subject: Part, verb: Part, object_: Part, triple: TripleMap, scope: Scope
    ) -> bool:
        """Return whether the constants of a pattern can match a triple map."""
        for part, column in ((subject, triple.subject), (object_, triple.object)):
            if isinstance(part, Value) and self._as_column(part, column) is None:
                return False
        typed = isinstance(verb, Value) and verb.constant == (_RDF_TYPE, "I")
        # Entities have the types of the T-Box; only statements of named graphs have these, too.
        own = typed and isinstance(object_, Value) and object_.form == "type"
        if typed and triple in INFERENCES and isinstance(object_, Value):
            if object_.form == "type":
                name = self.constants.node((object_.constant or ("",))[0], as_type=True)[1]
                return name in self._inferred.types
            return (object_.constant or ("",))[0] in self._inferred.classes
        own = own and self._is_map(scope)
        return not (own and triple in STATEMENTS)

    def _prune(self, patterns: list[_Pattern], scope: Scope) -> None:
        """Remove the triple maps whose terms no other pattern can have, until all are needed."""
        while True:
            forms: dict[str, list[set[Form]]] = {
                name: [{value.form}] for name, value in scope.bindings.items()
            }
            for pattern in patterns:
                each: dict[str, set[Form]] = {}
                for triple in pattern.maps:
                    for part, form in pattern.sides(triple):
                        if isinstance(part, str):
                            each.setdefault(part, set()).add(form)
                for name, found in each.items():
                    forms.setdefault(name, []).append(found)
            changed = False
            for pattern in patterns:
                kept = [
                    triple
                    for triple in pattern.maps
                    if all(
                        can_join(form, others)
                        for part, form in pattern.sides(triple)
                        if isinstance(part, str)
                        for others in forms[part]
                    )
                ]
                changed |= len(kept) < len(pattern.maps)
                pattern.maps = kept
            if not changed:
                return

    def _joined(self, patterns: list[_Pattern], scope: Scope) -> Rows:
        rows = Rows()
        aliases: dict[tuple[str, Part | str], str] = {}
        loose: list[tuple[str, Value]] = []
        anchored: set[str] = set(scope.bindings)
        together = [
            {side for side in (p.subject, p.object) if isinstance(side, str)}
            for p in patterns
            if len(p.maps) == 1 and p.maps[0].source.one_map
        ]
        for pattern in sorted(patterns, key=lambda p: len(p.maps) != 1):
            if len(pattern.maps) == 1:
                (triple,) = pattern.maps
                found = self._match(pattern, triple, aliases)
                name = pattern.subject
                if isinstance(name, str) and NODES.get(triple.subject.form):
                    if triple.source.map_id is not None or _is_anchored(pattern, triple, set()):
                        anchored.add(name)
                    else:
                        loose.append((name, found.variables[name]))
                rows.join(found, self.namespace)
            elif pattern.maps:
                parts = []
                _spread(anchored, together)
                for triple in pattern.maps:
                    part = self._match(pattern, triple, {})
                    if not _is_anchored(pattern, triple, anchored):
                        self._anchor(part, pattern.subject, triple)
                    _use_keys(part, rows.variables)
                    self._correlate(part, rows)
                    part.where += [
                        same(part.variables[name], scope.given[name], self.namespace)
                        for name in (pattern.subject, pattern.object)
                        if isinstance(name, str) and name in scope.given
                    ]
                    parts.append(part)
                rows.join(union(parts, self.parameters, self.namespace), self.namespace)
            else:
                for name in (pattern.subject, pattern.predicate, pattern.object):
                    if isinstance(name, str):
                        rows.variables.setdefault(name, UNBOUND)
                rows.where.append("false")
        for name, value in loose:
            _spread(anchored, together)
            if name not in anchored:
                anchored.add(name)
                self._add_anchor(rows, value)
        _share_rows(rows)
        return rows

    def _correlate(self, part: Rows, rows: Rows) -> None:
        """Limit a part of a union to keys that are known before it: then it uses its indexes."""
        for name, value in part.variables.items():
            known = rows.variables.get(name)
            is_node = known is not None and known.form in NODES and known.form == value.form
            if known is not None and is_node and name not in rows.nullable:
                part.where.append(same(value, known, self.namespace))

    def _anchor(self, rows: Rows, subject: Part, triple: TripleMap) -> None:
        if isinstance(subject, str) and triple.source.map_id is None:
            self._add_anchor(rows, rows.variables[subject])

    def _add_anchor(self, rows: Rows, value: Value) -> None:
        """Limit an entity, or a node that belongs to one, to the map."""
        node = NODES.get(value.form)
        if node is not None and node.of_map:
            alias = self.parameters.alias()
            rows.froms.append(f"entity {alias}")
            rows.where += [f"{alias}.id = {value.sql}", f"{alias}.map_id = {self.map_id}"]

    def _match(
        self, pattern: _Pattern, triple: TripleMap, aliases: dict[tuple[str, Part | str], str]
    ) -> Rows:
        """Return the rows of a triple map that match a pattern.

        Patterns with the same subject share the table of which it is the key.
        """
        letters: dict[str, str] = {}
        rows, source = Rows(), triple.source
        for letter, table in source.tables:
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
        object_ = _placed(triple.object, letters)
        for part, value in (
            (pattern.subject, _placed(triple.subject, letters)),
            (pattern.object, object_),
        ):
            if isinstance(part, str):
                rows.bind(part, value, self.namespace)
            else:
                constant = self._as_column(part, Column(value.form, value.sql, value.tag))
                assert constant is not None
                rows.where.append(same(value, constant, self.namespace))
        if triple.nullable and isinstance(pattern.object, str):
            rows.where.append(f"{object_.sql} IS NOT NULL")
        self._match_verb(rows, pattern, triple, letters)
        if triple.property and triple.name == "{b}.key" and isinstance(pattern.object, Value):
            self._use_index_of_properties(rows, pattern, letters)
        if triple in STATEMENTS:
            self._match_graph(rows, letters["a"], self._graph)
        elif triple in INFERENCES and isinstance(self._graph, str):
            graph = Value("iri", f"'{INFERRED_GRAPH}'::text")
            rows.bind(self._graph, graph, self.namespace)
        rows.where = list(dict.fromkeys(rows.where))
        return rows

    def _match_graph(self, rows: Rows, alias: str, graph: Part | None) -> None:
        if graph is None and self._chosen is None:
            rows.where.append(f"{alias}.graph = ''")
        elif graph is None:
            assert self._chosen is not None
            graphs = self.parameters.bind(list(self._chosen.default), "text[]")
            rows.where.append(f"{alias}.graph = ANY ({graphs})")
            if len(self._chosen.default) > 1:
                rows.where.append(_IN_NO_EARLIER.format(a=alias, graphs=graphs))
        elif isinstance(graph, Value):
            rows.where.append(f"{alias}.graph = {text_of(graph, self.namespace)}")
            named = None if self._chosen is None else self._chosen.named
            if named is not None and graph.constant and graph.constant[0] not in named:
                rows.where.append("false")
        else:
            rows.where.append(f"{alias}.graph <> ''")
            if self._chosen is not None:
                graphs = self.parameters.bind(list(self._chosen.named), "text[]")
                rows.where.append(f"{alias}.graph = ANY ({graphs})")
            rows.bind(graph, Value("iri", f"{alias}.graph"), self.namespace)

    def _match_verb(
        self, rows: Rows, pattern: _Pattern, triple: TripleMap, letters: Mapping[str, str]
    ) -> None:
        name = triple.name and triple.name.format(**letters)
        if isinstance(pattern.predicate, str):
            sql = f"'{triple.property}'::text"
            if name is not None:
                sql = f"('{triple.property}' || iri_encode({name}))" if triple.property else name
            rows.bind(pattern.predicate, Value("iri", sql), self.namespace)
        elif name is not None and pattern.predicate.constant:
            local = pattern.predicate.constant[0][len(triple.property) :]
            key = decode(local) if triple.property else local
            rows.where.append("false" if key is None else f"{name} = {self._bind(key)}")

    def _use_index_of_properties(
        self, rows: Rows, pattern: _Pattern, letters: Mapping[str, str]
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

    def _as_column(self, constant: Value, column: Column) -> Value | None:
        """Return a constant in the form of a column; None where no row can have it."""
        form = column.form
        text, tag = constant.constant or ("", "I")
        if form == "iri" and column.sql.startswith("'") and column.sql != f"'{text}'::text":
            return None
        if form == "iri" and column.sql.startswith("('"):  # a computed name in a namespace
            namespace = column.sql[2:].partition("'")[0]
            return Value("iri", self._bind(text)) if text.startswith(namespace) else None
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
        if tag != "I" or (form == "iri" and constant.form == "entity"):
            return None
        if form == "iri":
            return Value("iri", self._bind(text))
        # Of an IRI that is a node of another kind, or none, no row is.
        return None

    def _equals(self, value: Value, constant: Value) -> str:
        known = self._as_column(constant, Column(value.form, value.sql, value.tag))
        return "false" if known is None else same(value, known, self.namespace)

    # Property paths

    def _negated(
        self, subject: Part, path: NegatedPath, object_: Part, scope: Scope
    ) -> Iterable[Rows]:
        """Yield the rows of a negated property set, for each direction."""
        forward = [a for a in path.args if not isinstance(a, InvPath)]
        backward = [_inner(a) for a in path.args if isinstance(a, InvPath)]
        for excluded, start, end in ((forward, subject, object_), (backward, object_, subject)):
            if not excluded:
                continue
            verb = rdflib.Variable(self.fresh())
            rows = self._one(start, verb, end, scope)
            value = rows.variables.pop(str(verb))
            for iri in excluded:
                rows.where.append(f"{value.sql} <> {self._bind(self.constants.property(str(iri)))}")
            yield rows

    def _walk(self, rows: Rows, start: Part, path: MulPath, end: Part, scope: Scope) -> None:
        """Join a path of any length: a recursive query, from the side that is known."""
        given = {}
        for side, part in (("a", start), ("b", end)):
            if isinstance(part, Value):
                given[side] = part
            elif part in rows.variables and part not in rows.nullable:
                given[side] = rows.variables[part]
            elif part in scope.bindings and part not in rows.variables:
                given[side] = scope.bindings[part]
        scope = self._inside(scope)
        step = self._one("*a", path.path, "*b", scope)
        step_forms = [step.variables["*a"], step.variables["*b"]]
        zero = path.mod in ("*", "?")
        constant = "b" if isinstance(end, Value) and not isinstance(start, Value) else "a"
        from_side = constant if constant in given else next(iter(given), None)
        if from_side is None:
            found = self._all_paths(step, path.mod, scope)
        else:
            form = union_form([*step_forms, given[from_side]])
            one = self._pairs(step, form, reverse=from_side == "b")
            seed = in_form(given[from_side], form, self.namespace)
            found = self._reached(one, seed, form, path.mod, zero)
            reached = "b" if from_side == "a" else "a"
            found.variables = {f"*{reached}": found.variables["*"]}
            found.variables[f"*{from_side}"] = given[from_side]
        rows.join(self._renamed(found, {"*a": start, "*b": end}), self.namespace)

    def _pairs(self, step: Rows, form: Form, *, reverse: bool) -> str:
        """Return a SELECT of both ends of a step in one form."""
        a, b = (in_form(step.variables[n], form, self.namespace) for n in ("*a", "*b"))
        return step.select((b, a) if reverse else (a, b))

    def _reached(self, one: str, seed: Value, form: Form, mod: str, zero: bool) -> Rows:
        """Return the nodes that are reached from a node."""
        wide = form == "term"
        columns = "x, xt" if wide else "x"
        begin = ", ".join(seed.columns())
        s, r, q = (self.parameters.alias(letter) for letter in "srq")
        match_seed = f"{s}.c0 = {seed.sql}" + (f" AND {s}.c1 = {seed.tag}" if wide else "")
        match_step = f"{s}.c0 = {r}.x" + (f" AND {s}.c1 = {r}.xt" if wide else "")
        next_columns = f"{s}.c2, {s}.c3" if wide else f"{s}.c1"
        first = f"SELECT {next_columns} FROM ({one}) {s} WHERE {match_seed}"
        if mod == "?":
            text = f"SELECT {begin} UNION {first}"
            found = f"LATERAL ({text}) {q} ({columns})"
        else:
            base = f"SELECT {begin}" if zero else first
            found = (
                f"LATERAL (WITH RECURSIVE {r} ({columns}) AS ({base} UNION "
                f"SELECT {next_columns} FROM {r}, LATERAL ({one}) {s} WHERE {match_step}) "
                f"SELECT {columns} FROM {r}) {q}"
            )
        value = Value(form, f"{q}.x", f"{q}.xt" if wide else None)
        return Rows([found], variables={"*": value})

    def _all_paths(self, step: Rows, mod: str, scope: Scope) -> Rows:
        """Return all pairs of nodes that a path joins."""
        zero = mod in ("*", "?")
        form = "term" if zero else union_form([step.variables["*a"], step.variables["*b"]])
        one = self._pairs(step, form, reverse=False)
        wide = form == "term"
        columns = "a, at, b, bt" if wide else "a, b"
        s, r, q = (self.parameters.alias(letter) for letter in "srq")
        base = one
        if zero:
            base = f"{one} UNION {self._every_node(scope)}"
        if mod == "?":
            found = f"LATERAL ({base}) {q} ({columns})"
        else:
            match = f"{s}.c0 = {r}.b" + (f" AND {s}.c1 = {r}.bt" if wide else "")
            ends = f"{r}.a, {r}.at, {s}.c2, {s}.c3" if wide else f"{r}.a, {s}.c1"
            found = (
                f"LATERAL (WITH RECURSIVE {r} ({columns}) AS ({base} UNION "
                f"SELECT {ends} FROM {r}, LATERAL ({one}) {s} WHERE {match}) "
                f"SELECT {columns} FROM {r}) {q}"
            )
        return Rows(
            [found],
            variables={
                "*a": Value(form, f"{q}.a", f"{q}.at" if wide else None),
                "*b": Value(form, f"{q}.b", f"{q}.bt" if wide else None),
            },
        )

    def _every_node(self, scope: Scope) -> str:
        """Return a SELECT of each subject and object, twice."""
        rows = self._one("*s", rdflib.Variable("*p"), "*o", scope)
        selects = []
        for name in ("*s", "*o"):
            node = as_term(rows.variables[name], self.namespace)
            selects.append(rows.select((node, node)))
        return " UNION ".join(selects)

    # Relations that functions compute

    def _relate(self, rows: Rows, a: Part, relation: Computed, b: Part, scope: Scope) -> None:
        """Join a relation between entities, by its index where one side is known."""
        known: dict[str, str] = {}
        for side, part in (("a", a), ("b", b)):
            value = part if isinstance(part, Value) else rows.variables.get(part)
            if value is None and isinstance(part, str):
                value = scope.bindings.get(part)
                if value is not None:
                    rows.bind(part, value, self.namespace)
            if value is not None and value.form not in ("entity", "term"):
                rows.where.append("false")
            if value is not None and value.form == "entity":
                known[side] = value.sql
        missing = {"a": a, "b": b}
        if not known:
            known["a"] = self._any_entity(rows, a)
        if len(known) == 2:
            rows.where.append(f"{known['a']} <> {known['b']}")
            rows.where.append(relation.decide.format(**known))
            return
        (side,) = {"a", "b"} - known.keys()
        part = missing[side]
        function = relation.converse if side == "b" else relation.members
        if function is None:
            known[side] = self._any_entity(rows, part)
            rows.where.append(f"{known['a']} <> {known['b']}")
            rows.where.append(relation.decide.format(**known))
            return
        alias = self.parameters.alias("f")
        rows.froms.append(f"LATERAL {function.format(**known)} AS {alias} (member)")
        found = Value("entity", f"{alias}.member")
        if isinstance(part, Value):
            rows.where.append(self._equals(found, part))
        else:
            rows.bind(part, found, self.namespace)

    def _any_entity(self, rows: Rows, part: Part) -> str:
        alias = self.parameters.alias()
        rows.froms.append(f"entity {alias}")
        rows.where.append(f"{alias}.map_id = {self.map_id}")
        value = Value("entity", f"{alias}.id")
        if isinstance(part, Value):
            rows.where.append(self._equals(value, part))
        else:
            rows.bind(part, value, self.namespace)
        return value.sql


def _is_anchored(pattern: _Pattern, triple: TripleMap, anchored: set[str]) -> bool:
    """Return whether the other end of a triple limits its subject to the map."""
    end = pattern.object
    known = end in anchored if isinstance(end, str) else end.form == "entity"
    return triple.source.one_map and triple.object.form == "entity" and known


def _spread(anchored: set[str], together: list[set[str]]) -> None:
    """Add the variables that are in the map because another one is."""
    while more := [names for names in together if names & anchored and not names <= anchored]:
        for names in more:
            anchored |= names


def _share_rows(rows: Rows) -> None:
    """Read a row once that patterns join to itself by its key, as paths over geometries do."""
    while joined := next((c for c in rows.where if _is_row_with_itself(rows, c)), None):
        kept, _, gone = _SAME_KEY.fullmatch(joined).groups()  # type: ignore[union-attr]
        old, new = re.compile(rf"\b{gone}\."), f"{kept}."
        rows.froms = [old.sub(new, table) for table in rows.froms if _alias(table) != gone]
        rows.where = [old.sub(new, each) for each in rows.where if each != joined]
        rows.variables = {
            name: replace(v, sql=old.sub(new, v.sql), tag=v.tag and old.sub(new, v.tag))
            for name, v in rows.variables.items()
        }
    rows.where = list(dict.fromkeys(rows.where))


def _is_row_with_itself(rows: Rows, condition: str) -> bool:
    """Return whether a condition joins a table to itself by a column that is unique."""
    joined = _SAME_KEY.fullmatch(condition)
    if joined is None:
        return False
    a, column, b = joined.groups()
    tables = {_alias(t): t.split(" ")[0] for t in rows.froms if _PLAIN.fullmatch(t)}
    same_table = a != b and a in tables and tables[a] == tables.get(b)
    return same_table and _KEYS.get(tables[a]) == f"{{a}}.{column}"


def _alias(table: str) -> str:
    return table.rsplit(" ", 1)[-1]


def _use_keys(part: Rows, known: Mapping[str, Value]) -> None:
    """Compare the IRIs of statements by the keys of nodes that a variable is bound to already."""
    for name, value in part.variables.items():
        form = known[name].form if name in known else "iri"
        node = NODES.get(form)
        if value.form == "iri" and node is not None and node.prefix and not node.of_map:
            part.variables[name] = key_of(value, form)


def _is_inferred_graph(graph: Part | None) -> bool:
    return isinstance(graph, Value) and graph.constant == (INFERRED_GRAPH, "I")


def _placed(column: Column, letters: Mapping[str, str]) -> Value:
    """Return a column of the tables that letters stand for."""
    tag = None if column.tag is None else column.tag.format(**letters)
    return Value(column.form, column.sql.format(**letters), tag)


def _inner(path: Any) -> Any:
    """Return the property of an inverse path, which rdflib wraps twice."""
    while isinstance(path, InvPath):
        path = path.arg
    return path
