"""Triple patterns and property paths as rows of the tables that the mapping names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import rdflib
from rdflib.paths import AlternativePath, InvPath, MulPath, NegatedPath, SequencePath

from semmap.knowledge.fields.properties import is_of_fields, is_of_voxels
from semmap.knowledge.mapping import (
    COMPUTED,
    INFERENCES,
    NODES,
    REWRITTEN,
    REWRITTEN_IN_GRAPHS,
    REWRITTEN_OF_BOTH,
    SERIALIZATIONS,
    STATEMENTS,
    TRIPLES,
    is_mapped,
)
from semmap.knowledge.sparql.expressions import UntranslatedError
from semmap.knowledge.sparql.paths import PropertyPaths
from semmap.knowledge.sparql.relation import UNBOUND, Rows, can_join, share_rows, union
from semmap.knowledge.sparql.scope import MapGraph, Part, PatternScope
from semmap.knowledge.sparql.triple_match import MatchedPattern
from semmap.knowledge.sparql.values import NUMBERED, key_of, number_of, same
from semmap.knowledge.triple_map import Computed, Form, TripleMap, Value
from semmap.knowledge.vocabulary import RDF

_RDF_TYPE = f"{RDF}type"
_COMPUTED = {each.property: each for each in COMPUTED}
_REWRITTEN_STATED = frozenset((*REWRITTEN_IN_GRAPHS, *REWRITTEN_OF_BOTH))


class TriplePatterns(PropertyPaths):
    """Translates triple patterns; `uses` is how often each variable occurs in the whole query."""

    def __init__(self, source: MapGraph, uses: Mapping[str, int] | None = None) -> None:
        super().__init__(source)
        self._uses = uses or {}
        self.relations: set[str] = set()  # of which all pairs could be read, see `MapGraph.pairs`

    def sources(self, triple: tuple[Any, Any, Any], graph: Any) -> MatchedPattern | Computed:
        """Return what can match a pattern in a graph: triple maps, or its relation."""
        subject, predicate, object_ = triple
        scope = PatternScope(None if graph is None else self.part(graph))
        iri = self._of_map(predicate, scope)
        if iri in _COMPUTED:
            return _COMPUTED[iri]
        if is_of_fields(iri) or is_of_voxels(iri):
            raise UntranslatedError(f"fields state {predicate.n3()}")
        return self._matched(self.part(subject), predicate, self._end(predicate, object_), scope)

    def _matched(
        self, subject: Part, predicate: Any, object_: Part, scope: PatternScope
    ) -> MatchedPattern:
        verb = self.part(predicate)
        if isinstance(verb, Value):
            text = self.constants.property(str(predicate))
            verb = Value("iri", self._bind(text), None, (text, "I"))
        fits = [m for m in self._maps(verb, scope) if self._fits(subject, verb, object_, m, scope)]
        named = isinstance(verb, Value) and verb.constant != (_RDF_TYPE, "I")
        if not (self._tbox or named or isinstance(subject, Value) or isinstance(object_, Value)):
            fits = [each for each in fits if each.subject.form != "type"]
        return MatchedPattern(subject, verb, object_, fits)

    def _end(self, predicate: Any, object_: Any) -> Part:
        end = self.part(object_)
        if str(predicate) == _RDF_TYPE and isinstance(end, Value):
            return self.constant(object_, as_type=True)
        return end

    def triples(self, triples: Iterable[tuple[Any, Any, Any]], scope: PatternScope) -> Rows:
        """Return the solutions of triple patterns that must all match."""
        outside, self._graph = self._graph, scope.graph
        try:
            return self._all_triples(triples, scope)
        finally:
            self._graph = outside

    def _all_triples(self, triples: Iterable[tuple[Any, Any, Any]], scope: PatternScope) -> Rows:
        plain: list[MatchedPattern] = []
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
            elif (iri := self._of_map(predicate, scope)) in _COMPUTED:
                computed.append((subject, _COMPUTED[iri], object_))
            elif is_of_fields(iri):
                stated.append((subject, predicate, object_))
            elif is_of_voxels(iri):
                either.append((subject, predicate, object_))
            else:
                plain.append(self._matched(subject, predicate, object_, scope))

        for subject, predicate, object_ in triples:
            add(self.part(subject), predicate, self._end(predicate, object_))
        voxels = {subject for subject, verb, _ in stated if is_of_voxels(self._of_map(verb, scope))}
        for subject, predicate, object_ in either:
            if subject in voxels:
                stated.append((subject, predicate, object_))
            else:
                plain.append(self._matched(subject, predicate, object_, scope))
        prune(plain, {name: [{value.form}] for name, value in scope.bindings.items()})
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

    def _of_map(self, predicate: Any, scope: PatternScope) -> str:
        """Return the property of a pattern that reads the map; "" of other graphs and for any."""
        if isinstance(predicate, rdflib.URIRef) and self._is_map(scope):
            return self.constants.property(str(predicate))
        return ""

    def _join_fields(
        self, rows: Rows, stated: list[tuple[Part, Any, Part]], scope: PatternScope
    ) -> None:
        """Join what fields answer; variables that nothing else needs are counted there."""
        if self._fields is None:
            properties = ", ".join(dict.fromkeys(verb.n3() for _, verb, _ in stated))
            raise UntranslatedError(f"fields cannot be asked for {properties} here")

        def is_needed(name: str, count: int) -> bool:
            return name.startswith("*") or self._uses.get(name, 0) > count

        found, equal = self._fields.rows(
            stated, self.constants, self.parameters, is_needed, scope.conditions
        )
        for part in found:
            for name in part.variables.keys() & equal.keys():
                part.where.append(self._equals(part.variables.pop(name), equal[name]))
            rows.join(part, self.namespace)

    def _is_map(self, scope: PatternScope) -> bool:
        """Return whether a pattern reads the map, and not only statements of chosen graphs."""
        return scope.graph is None and self._chosen is None

    def _maps(self, verb: Part, scope: PatternScope) -> Iterable[TripleMap]:
        """Yield the triple maps of a property; all facts for a variable."""
        if not self._is_map(scope):
            yield from STATEMENTS
            if isinstance(verb, Value) and any(map(self.constants.is_stated, SERIALIZATIONS)):
                yield from _of_property(REWRITTEN_IN_GRAPHS, verb)
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
        known = self.constants
        if any(map(known.is_foreign, SERIALIZATIONS)):
            yield from _of_property((*REWRITTEN_IN_GRAPHS, *REWRITTEN_OF_BOTH), verb)
        if known.is_foreign(iri) if is_mapped(iri) else known.is_stated(iri):
            yield from STATEMENTS

    def _inferences(self, verb: Part) -> Iterable[TripleMap]:
        known = self._inferred.properties
        if known and (isinstance(verb, str) or (verb.constant or ("",))[0] in known):
            yield from INFERENCES

    def _fits(
        self, subject: Part, verb: Part, object_: Part, triple: TripleMap, scope: PatternScope
    ) -> bool:
        """Return whether the constants of a pattern can match a triple map."""
        for part, column in ((subject, triple.subject), (object_, triple.object)):
            if isinstance(part, Value) and self._as_column(part, column) is None:
                return False
        typed = isinstance(verb, Value) and verb.constant == (_RDF_TYPE, "I")
        # Entities have the types of the T-Box; statements about them only in named graphs.
        own = typed and isinstance(object_, Value) and object_.form == "type"
        if typed and triple in INFERENCES and isinstance(object_, Value):
            if object_.form == "type":
                name = self.constants.node((object_.constant or ("",))[0], as_type=True)[1]
                return self.constants.class_of(name) in self._inferred.classes
            return (object_.constant or ("",))[0] in self._inferred.classes
        if not own or triple not in STATEMENTS or not self._is_map(scope):
            return True
        class_ = object_.constant if isinstance(object_, Value) else None
        return self.constants.is_foreign((class_ or ("",))[0])

    def _joined(self, patterns: list[MatchedPattern], scope: PatternScope) -> Rows:
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
            # A relation may be stated, too, and follow from several geometries.
            distinct = any(triple in _REWRITTEN_STATED for triple in pattern.maps)
            if self._graph is None and self._chosen is not None and len(self._chosen.default) > 1:
                distinct |= any(triple in INFERENCES for triple in pattern.maps)
            if len(pattern.maps) == 1 and not distinct:
                (triple,) = pattern.maps
                found = self._match(pattern, triple, aliases)
                name = pattern.subject
                if isinstance(name, str) and triple.subject.form in (*NODES, "resource"):
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
                    named = isinstance(pattern.subject, str) and triple.source.map_id is None
                    if named and not _is_anchored(pattern, triple, anchored):
                        self._add_anchor(part, part.variables[str(pattern.subject)])
                    _use_keys(part, rows.variables)
                    self._use_numbers(part, rows)
                    self._correlate(part, rows, by_number=distinct)
                    part.where += [
                        same(part.variables[name], scope.given[name], self.namespace)
                        for name in (pattern.subject, pattern.object)
                        if isinstance(name, str) and name in scope.given
                    ]
                    parts.append(part)
                found = union(parts, self.parameters, self.namespace, distinct=distinct)
                rows.join(found, self.namespace)
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
        share_rows(rows)
        return rows

    def _use_numbers(self, part: Rows, rows: Rows) -> None:
        """Let a variable of a part be the number of a term, as which it is known before it."""
        for name, value in part.variables.items():
            known = rows.variables.get(name)
            numbered = known is not None and known.form in ("resource", "stored")
            if numbered and value.form not in NUMBERED and name not in rows.nullable:
                part.variables[name] = Value("stored", number_of(value, self.namespace))

    def _correlate(self, part: Rows, rows: Rows, *, by_number: bool) -> None:
        """Limit a part of a union to keys that are known before it: then it uses its indexes.

        By the number of one end: by both, it would be read for each pair of these.
        """
        for name, value in part.variables.items():
            known = rows.variables.get(name)
            is_node = known is not None and known.form in NODES and known.form == value.form
            if by_number and known is not None:
                is_node |= known.form in NUMBERED and value.form in NUMBERED
            if known is not None and is_node and name not in rows.nullable:
                part.where.append(same(value, known, self.namespace))
                if by_number:
                    break

    def _add_anchor(self, rows: Rows, value: Value) -> None:
        """Limit an entity, or a node that belongs to one, to the map."""
        node = NODES.get(value.form)
        if node is not None and node.of_map:
            alias = self.parameters.alias()
            rows.froms.append(f"entity {alias}")
            rows.where += [f"{alias}.id = {value.sql}", f"{alias}.map_id = {self.map_id}"]

    def _relate(
        self, rows: Rows, a: Part, relation: Computed, b: Part, scope: PatternScope
    ) -> None:
        """Join a relation between entities, by its index where one side is known."""
        known: dict[str, str] = {}
        outer = False  # whether it is for each row of what it is joined with
        for side, part in (("a", a), ("b", b)):
            value = part if isinstance(part, Value) else rows.variables.get(part)
            if value is None and isinstance(part, str):
                value = scope.bindings.get(part)
                if value is not None:
                    rows.bind(part, value, self.namespace)
                    outer = True
            if value is not None and value.form not in ("entity", "term"):
                rows.where.append("false")
            if value is not None and value.form == "entity":
                known[side] = value.sql
        if not outer and relation.pairs is not None and self._reads_pairs(relation, a, b, known):
            alias = self.parameters.alias("f")
            pairs = relation.pairs.format(map=self.map_id, f=alias)
            rows.froms.append(f"LATERAL {pairs}")
            for side, part in (("a", a), ("b", b)):
                value = Value("entity", f"{alias}.{side}")
                if side in known:
                    rows.where.append(f"{value.sql} = {known[side]}")
                    continue
                if isinstance(part, str) and self._uses.get(part, 0) > 1:
                    self._add_anchor(rows, value)  # which has its name, too
                self._be(rows, part, value)
            return
        if not known:
            side, part = ("b", b) if relation.members and not relation.converse else ("a", a)
            known[side] = self._any_entity(rows, part)
        for side, part, function in (("a", a, relation.members), ("b", b, relation.converse)):
            if side not in known and function is not None:
                alias = self.parameters.alias("f")
                rows.froms.append(f"LATERAL {function.format(**known)} AS {alias} (member)")
                self._be(rows, part, Value("entity", f"{alias}.member"))
                return
            if side not in known:
                known[side] = self._any_entity(rows, part)
        rows.where += [f"{known['a']} <> {known['b']}", relation.decide.format(**known)]

    def _reads_pairs(self, relation: Computed, a: Part, b: Part, known: Mapping[str, str]) -> bool:
        """Return whether a pattern reads all pairs: not for one entity, which an index has."""
        if relation.kept is None:
            return not known
        sides = {"a": a, "b": b}
        if known and not any(isinstance(sides[side], str) for side in known):
            return False
        self.relations.add(relation.kept)
        return relation.kept in self._read_whole

    def _any_entity(self, rows: Rows, part: Part) -> str:
        alias = self.parameters.alias()
        rows.froms.append(f"entity {alias}")
        rows.where.append(f"{alias}.map_id = {self.map_id}")
        value = Value("entity", f"{alias}.id")
        self._be(rows, part, value)
        return value.sql


def prune(patterns: Iterable[MatchedPattern], known: Mapping[str, list[set[Form]]]) -> None:
    """Remove triple maps whose terms no other pattern, nor what is known of variables, can have."""
    changed = True
    while changed:
        forms = {name: list(sets) for name, sets in known.items()}
        for pattern in patterns:
            each: dict[str, set[Form]] = {}
            for triple in pattern.maps:
                for name, form in pattern.variables(triple):
                    each.setdefault(name, set()).add(form)
            for name, found in each.items():
                forms.setdefault(name, []).append(found)
        changed = False
        for pattern in patterns:
            kept = [
                triple
                for triple in pattern.maps
                if all(
                    can_join(form, others)
                    for name, form in pattern.variables(triple)
                    for others in forms[name]
                )
            ]
            changed |= len(kept) < len(pattern.maps)
            pattern.maps = kept


def _is_anchored(pattern: MatchedPattern, triple: TripleMap, anchored: set[str]) -> bool:
    """Return whether the other end of a triple limits its subject to the map."""
    end = pattern.object
    known = end in anchored if isinstance(end, str) else end.form == "entity"
    return triple.source.one_map and triple.object.form == "entity" and known


def _spread(anchored: set[str], together: list[set[str]]) -> None:
    """Add the variables that are in the map because another one is."""
    while more := [names for names in together if names & anchored and not names <= anchored]:
        for names in more:
            anchored |= names


def _use_keys(part: Rows, known: Mapping[str, Value]) -> None:
    """Compare the IRIs of statements by the keys of nodes that a variable is bound to already."""
    for name, value in part.variables.items():
        form = known[name].form if name in known else "iri"
        node = NODES.get(form)
        if value.form == "iri" and node is not None and node.prefix and not node.of_map:
            part.variables[name] = key_of(value, form)


def _of_property(maps: Iterable[TripleMap], verb: Value) -> Iterable[TripleMap]:
    return (triple for triple in maps if verb.constant == (triple.property, "I"))
