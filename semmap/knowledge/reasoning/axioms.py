"""The axioms of a map: of the shipped T-Box and of its statements; the rules that they make."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import rdflib

from semmap.ingest.ontology.tbox import ontology_files
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import is_mapped
from semmap.knowledge.reasoning.engine import (
    SAME_AS,
    TYPE_OF,
    Facts,
    Node,
    RuleSet,
    Triple,
    close,
)
from semmap.knowledge.reasoning.rules import (
    AXIOM_CLASSES,
    AXIOM_PROPERTIES,
    SUB,
    Compiled,
    compile_rules,
)
from semmap.knowledge.reasoning.told_facts import COLUMNS, Hierarchy, fact_of
from semmap.knowledge.sparql.constants import Constants, tag_and_text
from semmap.knowledge.sparql.stored_terms import term_of
from semmap.knowledge.vocabulary import prefixes, short

_EQUALITY = " with equality"
_NONE = Compiled(RuleSet(()), frozenset(), frozenset(), frozenset())


@dataclass(frozen=True)
class OntologyAxioms:
    """The axioms of a map, and of a named graph."""

    graph: str  # "" for the map's own
    digest: str  # changes with them
    hierarchy: Hierarchy  # of the T-Box
    axioms: frozenset[Triple]  # others
    of_map: frozenset[Triple]  # and those of them that the graph does not state
    stated_same: bool  # ``owl:sameAs`` is stated of something
    equality: bool  # the rules of equality are among `rules`
    rules: Compiled  # what the axioms make
    known: frozenset[Triple]  # what a graph does not have: it follows from the map's axioms alone

    @classmethod
    def read(cls, view: MapView, state: str = "", graph: str = "") -> OntologyAxioms:
        """Return the axioms of a map, and those that a named graph states besides.

        The state of the last run says if equality was among them.
        """
        hierarchy = Hierarchy.read(view)
        rows = view.session.execute(
            f"SELECT graph, {COLUMNS} FROM statement WHERE id IN (SELECT t.id FROM triple t "
            "WHERE t.map_id = %(map)s AND t.graph IN (0, term_id(%(graph)s)) "
            "AND (t.until IS NULL OR t.until > statement_timestamp()) "
            "AND (t.predicate IN (SELECT term_id(p) FROM unnest(%(properties)s::text[]) p) "
            "OR t.predicate = term_id(%(type)s) "
            "AND t.object IN (SELECT term_id(c) FROM unnest(%(classes)s::text[]) c)))",
            {
                "map": view.number,
                "graph": graph,
                "properties": [*AXIOM_PROPERTIES, SAME_AS],
                "type": TYPE_OF,
                "classes": list(AXIOM_CLASSES),
            },
        ).fetchall()
        stated = {fact_of(fact) for _, *fact in rows}
        shipped = _shipped_axioms()
        of_map = shipped | {fact_of(fact) for of_graph, *fact in rows if not of_graph}
        same = any(fact_of(fact)[1] == SAME_AS for of, *fact in rows if of == graph)
        axioms = frozenset({fact for fact in stated if fact[1] != SAME_AS} | shipped)
        parts = [hierarchy.digest, str(same), *sorted(map(repr, axioms))]
        if graph:
            parts += ["of which the map has", *sorted(map(repr, of_map))]
        digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()
        equality = same or state == digest + _EQUALITY
        read = cls(graph, digest, hierarchy, axioms, of_map, same, equality, _NONE, frozenset())
        return read._compiled(view)

    def with_equality(self, view: MapView, equality: bool) -> OntologyAxioms:
        """Return the same axioms with the rules of equality, or without, where none is stated."""
        return replace(self, equality=equality or self.stated_same)._compiled(view)

    def _compiled(self, view: MapView) -> OntologyAxioms:
        """Return the same axioms with what they make."""
        key = self.digest, self.equality
        if key not in _COMPILED:
            while len(_COMPILED) > _KEPT:
                del _COMPILED[next(iter(_COMPILED))]
            _COMPILED[key] = self._of_graph(view) if self.graph else self._of_types(view)
        rules, known = _COMPILED[key]
        return replace(self, rules=rules, known=known)

    def _of_types(self, view: MapView) -> tuple[Compiled, frozenset[Triple]]:
        """Compile the axioms of a map, which is told the types that subsume others."""
        supers = self.hierarchy.supers.items()
        rules = compile_rules(
            self.axioms | {(c, SUB, d) for c, d in self.hierarchy.parents},
            Words(view).node,
            built_in=frozenset((c, d) for c, above in supers for d in above),
            single=is_mapped,
            same=self.equality,
        )
        return rules, frozenset()

    def _of_graph(self, view: MapView) -> tuple[Compiled, frozenset[Triple]]:
        """Compile the axioms of a named graph, and close what those of the map alone state."""
        parents = {(c, SUB, d) for c, d in self.hierarchy.parents}
        of_map = compile_rules(self.of_map | parents, same=False)
        facts, stated = Facts(), of_map.stated()
        for fact in stated:
            facts.add(fact)
        close(facts, of_map.rules, stated)
        rules = compile_rules(
            self.axioms | parents, Words(view).node, known=frozenset(stated), same=self.equality
        )
        return rules, frozenset(facts.all()) - _schema(stated)

    @property
    def state(self) -> str:
        """What a run with these rules leaves."""
        return self.digest + (_EQUALITY if self.equality else "")

    def is_of(self, state: str) -> bool:
        """Return whether a run that left a state had the same axioms."""
        return state.removesuffix(_EQUALITY) == self.digest


_COMPILED: dict[tuple[str, bool], tuple[Compiled, frozenset[Triple]]] = {}
_KEPT = 15


def _schema(facts: Iterable[Triple]) -> frozenset[Triple]:
    """Return the facts about classes and properties, which no rule asks for."""
    return frozenset(fact for fact in facts if fact[1] in AXIOM_PROPERTIES)


@cache
def _shipped_axioms() -> frozenset[Triple]:
    """Return the axioms of `axioms.ttl`; domains in `fields.ttl` are of what a field represents."""
    (path,) = (path for path in ontology_files() if path.name == "axioms.ttl")
    graph = rdflib.Graph().parse(path, format="turtle")
    return frozenset((_shipped(s), _shipped(p), _shipped(o)) for s, p, o in graph)


def _shipped(term: Any) -> Node:
    text, tag = tag_and_text(term)
    return {"B": f"_:{text}", "I": text}.get(tag, (text, tag))


def node_of(view: MapView, term: Any, constants: Constants, *, as_type: bool = False) -> Node:
    """Return a term of a text as rules have it."""
    text, tag = tag_and_text(term)
    if tag != "I":
        return text, tag
    form, key = constants.node(text, as_type=as_type)
    if form == "type":
        return str(view.value("SELECT type_iri(%s)", key))
    return int(key) if form == "entity" else text


class Words:
    """Terms and proofs as text, entities by their names."""

    def __init__(self, view: MapView) -> None:
        self._view, self._names = view, cache(self._name)
        self._prefixes = prefixes(view.name)

    def _name(self, entity: int) -> str:
        iri = self._view.value("SELECT entity_iri(%s)", entity)
        return f"entity {entity}" if iri is None else self.node(iri)

    def node(self, node: Node) -> str:
        """Return a term; of a string, its text."""
        if isinstance(node, int):
            return str(self._names(node))
        if isinstance(node, str):
            return short(node, self._prefixes)
        return node[0]

    def fact(self, fact: Triple) -> str:
        """Return a triple as Turtle."""
        subject, verb, node = fact
        end = self.node(node)
        if isinstance(node, tuple):
            literal = term_of(*node)
            assert literal is not None
            end = literal.n3()
        return f"{self.node(subject)} {'a' if verb == TYPE_OF else self.node(verb)} {end}"
