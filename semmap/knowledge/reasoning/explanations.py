"""Why a fact is one, and what contradicts an axiom, in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import rdflib

from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import INFERRED_GRAPH
from semmap.knowledge.queries import limited
from semmap.knowledge.reasoning.axioms import OntologyAxioms, Words, node_of
from semmap.knowledge.reasoning.engine import TYPE_OF, Triple
from semmap.knowledge.reasoning.rules import CONTRADICTION
from semmap.knowledge.reasoning.store import StoredFacts
from semmap.knowledge.sparql.kept_queries import Session


@dataclass(frozen=True)
class Why:
    """Why a fact is one, in words."""

    fact: str  # as Turtle
    axiom: str = ""  # from which it follows; "" where it is told
    because: tuple[Why, ...] = ()  # the facts that meet the axiom

    def lines(self, indent: str = "") -> Iterator[str]:
        """Yield the lines of a text."""
        yield f"{indent}{self.fact}{f', as {self.axiom}:' if self.axiom else ''}"
        for reason_ in self.because:
            yield from reason_.lines(f"{indent}  ")

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        because = [each.as_json() for each in self.because]
        return {"fact": self.fact, "axiom": self.axiom or None, "because": because}


def contradictions(session: Session) -> list[Why]:
    """Return which facts contradict which axiom; or LookupError: the map is not reasoned about."""
    with limited(session, None):
        view, states = _states(session)
        words = Words(view)
        found = [
            why
            for graph in _with_contradictions(view)
            if (state := states.get(graph)) is not None
            for why in _clashes(StoredFacts(view, OntologyAxioms.read(view, state, graph)), words)
        ]
        return sorted(found, key=lambda each: (each.fact, each.axiom))


def _with_contradictions(view: MapView) -> list[str]:
    """Return the graphs with contradictions; "" for the map itself."""
    rows = view.session.execute(
        "SELECT DISTINCT graph FROM inference "
        "WHERE map_id = %s AND predicate = %s AND NOT told AND object IS NOT NULL",
        (view.number, CONTRADICTION),
    )
    return ["" if graph == INFERRED_GRAPH else graph for (graph,) in rows]


def _clashes(facts: StoredFacts, words: Words) -> Iterator[Why]:
    graph, rules = facts.ontology.graph, facts.ontology.rules.rules
    for fact in facts.match(None, CONTRADICTION, None):
        bodies = {frozenset(body): body for _, body in rules.reasons(facts, fact)}
        for body in bodies.values():
            proofs = (_proof(facts, words, each) for each in dict.fromkeys(body))
            because = tuple(each for each in proofs if each is not None)
            name = words.node(fact[0])
            about = f"GRAPH {rdflib.URIRef(graph).n3()} {{ {name} }}" if graph else name
            yield Why(about, words.node(fact[2]), because)


def why(session: Session, text: str) -> Why:
    """Return why a triple, or one of a graph, is a fact; QueryError, or LookupError: it is none."""
    with limited(session, None):
        view, states = _states(session)
        parsed = view.parsed(f"ASK {{ {text} }}")
        graph, pattern = "", parsed.algebra.p.p
        if pattern.name == "Graph":
            graph, pattern = pattern.term, pattern.p
        terms = pattern.triples[0] if len(pattern.get("triples") or ()) == 1 else None
        if terms is None:
            raise parsed.error("this is not one triple: give subject, property and object", 0)
        if not all(isinstance(t, (rdflib.URIRef, rdflib.Literal)) for t in (graph, *terms) if t):
            raise parsed.error("a fact has no variables: give subject, property and object", 0)
        words = Words(view)
        constants = view.constants(terms)
        verb = constants.property(str(terms[1]))
        subject = node_of(view, terms[0], constants)
        node = node_of(view, terms[2], constants, as_type=verb == TYPE_OF)
        ontology = OntologyAxioms.read(view, states.get(str(graph), ""), str(graph))
        facts = StoredFacts(view, ontology)
        proof = _proof(facts, words, (subject, verb, node))
        if proof is not None:
            return proof
        if not view.run(view.statement(parsed.algebra.p, [], 1)):
            raise LookupError(f"{text.strip()} is not a fact of the map {view.name}")
        return Why(words.fact((subject, verb, node)))


def _proof(
    facts: StoredFacts, words: Words, fact: Triple, above: tuple[Triple, ...] = ()
) -> Why | None:
    """Return a proof of a fact from what is told; None where there is none."""
    if facts.is_told(fact):
        return Why(words.fact(fact))
    above = (*above, fact)
    for rule, body in facts.ontology.rules.rules.reasons(facts, fact):
        if any(atom in above for atom in body):
            continue
        found = [_proof(facts, words, atom, above) for atom in body]
        if all(found):
            because = tuple(each for each in found if each is not None)
            return Why(words.fact(fact), rule.text, because)
    return None


def _states(session: Session) -> tuple[MapView, dict[str, str]]:
    """Return what the last run left of the map ("") and of named graphs."""
    view = MapView.of(session)
    states = view.value(
        "SELECT graphs || jsonb_build_object('', axioms) FROM reasoning WHERE map_id = %s",
        view.number,
    )
    if states is None:
        raise LookupError(
            f"nothing is inferred from the map {view.name}: run semmap knowledge reason"
        )
    return view, states
