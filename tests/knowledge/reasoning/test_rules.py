"""The rules of OWL 2 RL against owlrl, and retraction against a closure from scratch."""

from __future__ import annotations

import warnings

import owlrl
import rdflib
from hypothesis import given, settings
from hypothesis import strategies as st
from rdflib import OWL, RDFS

from semmap.knowledge.reasoning.engine import (
    TYPE_OF,
    Facts,
    Triple,
    close,
)
from semmap.knowledge.reasoning.rules import (
    AXIOM_CLASSES,
    AXIOM_PROPERTIES,
    CONTRADICTION,
    Compiled,
    compile_rules,
)
from semmap.knowledge.sparql.constants import tag_and_text

EX = "http://example.org/"
PREFIXES = f"@prefix : <{EX}> . @prefix owl: <{OWL}> . @prefix rdfs: <{RDFS}> .\n"
CLASSES = tuple(f":C{i}" for i in range(5))
PROPERTIES = tuple(f":p{i}" for i in range(4))
PEOPLE = tuple(f":i{i}" for i in range(4))
AXIOMS = (
    "{c} rdfs:subClassOf {d} .",
    "{c} rdfs:subClassOf {d} .",
    "{c} owl:equivalentClass {d} .",
    "{c} owl:disjointWith {d} .",
    "{c} owl:complementOf {d} .",
    "{c} owl:intersectionOf ({d} {e}) .",
    "{c} owl:unionOf ({d} {e}) .",
    "{c} owl:oneOf ({i} {j}) .",
    "{c} owl:onProperty {p} ; owl:someValuesFrom {d} .",
    "{c} owl:onProperty {p} ; owl:someValuesFrom owl:Thing .",
    "{c} owl:onProperty {p} ; owl:allValuesFrom {d} .",
    "{c} owl:onProperty {p} ; owl:hasValue {i} .",
    "{c} owl:onProperty {p} ; owl:maxCardinality 0 .",
    "{c} owl:onProperty {p} ; owl:maxCardinality 1 .",
    "{c} owl:onProperty {p} ; owl:maxQualifiedCardinality 1 ; owl:onClass {d} .",
    "{c} owl:hasKey ({p} {q}) .",
    "[] a owl:AllDisjointClasses ; owl:members ({c} {d} {e}) .",
    "{p} rdfs:domain {c} .",
    "{p} rdfs:range {c} .",
    "{p} rdfs:subPropertyOf {q} .",
    "{p} owl:equivalentProperty {q} .",
    "{p} owl:inverseOf {q} .",
    "{p} owl:propertyDisjointWith {q} .",
    "{p} owl:propertyChainAxiom ({q} {r}) .",
    "{p} a owl:TransitiveProperty .",
    "{p} a owl:SymmetricProperty .",
    "{p} a owl:AsymmetricProperty .",
    "{p} a owl:IrreflexiveProperty .",
    "{p} a owl:FunctionalProperty .",
    "{p} a owl:InverseFunctionalProperty .",
    "[] owl:sourceIndividual {i} ; owl:assertionProperty {p} ; owl:targetIndividual {j} .",
)
STATED = (
    "{i} a {c} .",
    "{i} a {c} .",
    "{i} {p} {j} .",
    "{i} {p} {j} .",
    "{i} {p} {j} .",
    "{i} owl:sameAs {j} .",
    "{i} owl:differentFrom {j} .",
)


def sentences(templates: tuple[str, ...], most: int) -> st.SearchStrategy[list[str]]:
    one = st.builds(
        lambda template, c, d, e, p, q, r, i, j: template.format(**locals()),
        st.sampled_from(templates),
        *[st.sampled_from(CLASSES)] * 3,
        *[st.sampled_from(PROPERTIES)] * 3,
        *[st.sampled_from(PEOPLE)] * 2,
    )
    return st.lists(one, max_size=most)


def parsed(text: str) -> set[Triple]:
    def term(node: object) -> object:
        text, tag = tag_and_text(node)
        return text if tag in ("I", "B") else (text, tag)

    graph = rdflib.Graph().parse(data=PREFIXES + text, format="turtle")
    return {tuple(map(term, triple)) for triple in graph}


def is_axiom(fact: Triple) -> bool:
    return fact[1] in AXIOM_PROPERTIES or (fact[1] == TYPE_OF and fact[2] in AXIOM_CLASSES)


def materialised(told: set[Triple], compiled: Compiled) -> Facts:
    facts = Facts()
    for fact in told:
        facts.add(fact, told=True)
    for fact in compiled.stated():
        facts.add(fact)
    close(facts, compiled.rules, [*told, *compiled.stated()])
    return facts


def reasoned(text: str) -> tuple[Facts, Compiled]:
    stated = parsed(text)
    axioms = {fact for fact in stated if is_axiom(fact)}
    same = any(fact[1] == str(OWL.sameAs) for fact in stated)
    compiled = compile_rules(axioms, same=same)
    return materialised(stated - axioms, compiled), compiled


NAMED = {f"{EX}{name[1:]}" for name in (*CLASSES, *PROPERTIES, *PEOPLE)}
SCHEMA = {str(RDFS.subClassOf), str(RDFS.subPropertyOf), str(RDFS.domain), str(RDFS.range)}
SAME = str(OWL.sameAs)


def plain(facts: set[Triple]) -> set[Triple]:
    """What is about the named classes, properties and individuals, but not x = x, C is a C."""
    return {
        (s, p, o)
        for s, p, o in facts
        if s != o or (p in NAMED)
        if {s, o} <= NAMED and (p in NAMED or p in SCHEMA or p in (TYPE_OF, SAME))
    }


def by_owlrl(text: str) -> tuple[set[Triple], bool]:
    graph = rdflib.Graph().parse(data=PREFIXES + text, format="turtle")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        closure = owlrl.OWLRL_Semantics(graph, False, False, False)
        closure.closure()
    triples: set[Triple] = {(str(s), str(p), str(o)) for s, p, o in graph}
    return triples, bool(closure.error_messages)


@settings(max_examples=20, deadline=None)
@given(axioms=sentences(AXIOMS, 7), stated=sentences(STATED, 7))
def test_inferences_are_those_of_owlrl(axioms: list[str], stated: list[str]) -> None:
    text = "\n".join(axioms + stated)
    expected, clash = by_owlrl(text)
    facts, _ = reasoned(text)
    found = set(facts.all()) | parsed(text)
    assert plain(found) == plain(expected)
    assert any(fact[1] == CONTRADICTION for fact in found) == clash
