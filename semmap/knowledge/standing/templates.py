"""Shapes of standing queries: equal but for names, parsed and translated once, then filled."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import rdflib
from rdflib.paths import MulPath, NegatedPath, Path
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.knowledge.fields.properties import is_of_fields, is_of_voxels
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import FACTS
from semmap.knowledge.sparql.constants import Constants, iris_in
from semmap.knowledge.sparql.expressions import UntranslatedError
from semmap.knowledge.sparql.stored_terms import Term
from semmap.knowledge.sparql.translator import SqlStatement, translate_each
from semmap.knowledge.sparql.triples import TriplePatterns
from semmap.knowledge.standing.parts import PartPattern, QueryPart, reads_geometry, split
from semmap.knowledge.triple_map import Computed, Form
from semmap.knowledge.vocabulary import TYPE
from semmap.language.error import QueryError
from semmap.language.normalise import normalise, tokens
from semmap.language.parser import ParsedText
from semmap.language.syntax_tree import nodes_in

_HOLE = "urn:semmap:hole:"
_PLAIN = re.compile(r"[A-Za-z0-9_-]+")
_ROLES = ("node", "class")

Node = tuple[Form, Any]  # form and key of what an IRI stands for

Nodes = tuple[Node, Node]  # what an IRI stands for, as a node and as a class

Canonical = Callable[[Any, str], Term]
"""The term that solutions have for a "node", "class" or "property" of the text."""


@dataclass(frozen=True)
class Template:
    """A query with holes."""

    parsed: ParsedText  # with an IRI for each hole
    iris: frozenset[str]  # that the text has besides those of the holes


def template_of(
    view: MapView, text: str, kept: dict[str, Template | None]
) -> tuple[Template, tuple[str, ...]]:
    """Return the template of a text, which is parsed once, and the IRIs that fill its holes."""
    holed, filling = _with_holes(text, {"": view.namespace, "type": TYPE})
    if filling:
        if holed not in kept:
            kept[holed] = _template(view, holed)
        found = kept[holed]
        if found is not None:
            return found, filling
    parsed = view.parsed(text)
    return Template(parsed, frozenset(iris_in(parsed.algebra))), ()


def _template(view: MapView, holed: str) -> Template | None:
    """Return the template of a text with holes; None if they are not all nodes."""
    try:
        parsed = view.parsed(holed)
    except QueryError:
        return None
    if parsed.dataset or any(map(_is_hole, _properties(parsed.algebra))):
        return None
    return Template(parsed, frozenset(i for i in iris_in(parsed.algebra) if not _is_hole(i)))


def _with_holes(text: str, spaces: Mapping[str, str]) -> tuple[str, tuple[str, ...]]:
    """Return a text with holes for the plain names in some prefixes, and the IRIs of these."""
    sparql = normalise(text).sparql
    if _HOLE in sparql:
        return text, ()
    parts: list[str] = []
    holes: dict[str, int] = {}
    declares = False
    done = 0
    for kind, begin, end in tokens(sparql):
        if kind in ("space", "comment"):
            continue
        token = sparql[begin:end]
        if kind == "prefixed":
            prefix, _, local = token.partition(":")
            if declares and prefix in spaces:
                return text, ()
            if prefix in spaces and _PLAIN.fullmatch(local):
                number = holes.setdefault(spaces[prefix] + local, len(holes))
                parts += [sparql[done:begin], f"<{_HOLE}{number}>"]
                done = end
        declares = kind == "word" and token.upper() == "PREFIX"
    return "".join([*parts, sparql[done:]]), tuple(holes)


def _is_hole(iri: str) -> bool:
    return iri.startswith(_HOLE)


def _properties(tree: Any) -> Iterator[str]:
    for node in nodes_in(tree):
        if isinstance(node, CompValue):
            if node.name == "Function":
                yield str(node.iri)
            for triple in node.get("triples") or ():
                # The syntax of EXISTS has triples in a row.
                yield from iris_in(triple[1::3])


class TemplateShape:
    """The parts of queries of one template and forms of nodes; open: each text needs its own."""

    def __init__(
        self,
        view: MapView,
        template: Template,
        known: Constants,
        canonical: Canonical,
        filling: tuple[Nodes, ...] = (),
    ) -> None:
        self._constants = _with_holes_filled(known, filling)
        algebra, names = template.parsed.algebra, tuple(map(str, template.parsed.names))
        if template.parsed.form == "AskQuery":
            names = ()
        translator = TriplePatterns(view.graph(self._constants))
        parts = None
        if not template.parsed.dataset:
            try:
                parts = split(
                    algebra, names, translator.sources, lambda t, r: _canonical(t, r, canonical)
                )
            except UntranslatedError:
                parts = None
        if parts is None:
            parts = [_whole_part(algebra, names, self._constants, translator)]
        self._parts = parts
        self._statements: list[dict[Any, SqlStatement | None]] = [{} for _ in parts]
        self.is_open = False
        for part, kept in zip(parts, self._statements, strict=True):
            kept[()] = None
            if not template.parsed.dataset:
                kept[()] = translated(view, part, self._constants, {})
            self.is_open |= bool(filling) and not _is_closed(kept[()], filling)

    def filled(self, query: Any, iris: frozenset[str], filling: Filled | None) -> list[QueryPart]:
        """Return the parts of a query, with its terms in the holes if there are any."""
        parts = []
        for part, kept in zip(self._parts, self._statements, strict=True):
            terms, values = ({}, {}) if filling is None else (filling.terms, filling.values)
            made = replace(
                part,
                patterns=[_filled(each, filling) if filling else each for each in part.patterns],
                conditions=tuple(
                    each._replace(term=terms.get(each.term, each.term)) for each in part.conditions
                ),
                iris=iris,
                query=query,
                constants=self._constants,
                values=values,
                statements=kept,
                rows=set(),
            )
            parts.append(made)
        return parts


class Filled:
    """The terms and values in the holes of a query, by the IRIs in them and their nodes."""

    def __init__(
        self,
        iris: tuple[str, ...],
        nodes: tuple[Nodes, ...],
        canonical: Canonical,
        class_of: Callable[[str], str],
    ) -> None:
        self.values: dict[Any, Any] = {}
        self.terms: dict[Term, Term] = {}
        for i, (iri, (node, as_class)) in enumerate(zip(iris, nodes, strict=True)):
            hole, entity, name, class_ = _stand_ins(i)
            self.values[hole] = iri
            if node[0] == "entity":
                self.values[entity] = node[1]
            if as_class[0] == "type":
                self.values[name] = as_class[1]
                self.values[class_] = class_of(as_class[1])
            for role in _ROLES:
                self.terms[_marked(hole, role)] = canonical(rdflib.URIRef(iri), role)


def translated(
    view: MapView, part: QueryPart, constants: Constants, given: Mapping[str, Form]
) -> SqlStatement | None:
    """Return the statement of a part; None if it has no translation."""
    try:
        return translate_each(part.tree, part.names, view.graph(constants), given)
    except UntranslatedError:
        return None


def _stand_ins(number: int) -> tuple[str, int, str, str]:
    """Return what stands for a hole: its IRI, the id of an entity, name and class of a type."""
    hole = f"{_HOLE}{number}"
    return hole, -(10**15) - number, f"{hole}#name", f"{hole}#type"


def _marked(iri: str, role: str) -> Term:
    return rdflib.URIRef(f"{iri}#{role}")


def _with_holes_filled(known: Constants, filling: tuple[Nodes, ...]) -> Constants:
    """Return constants in which each hole is a node that there is not."""
    nodes: dict[str, Node] = {}
    types: dict[str, str] = {}
    classes: dict[str, str] = {}
    for i, (node, as_class) in enumerate(filling):
        hole, entity, name, class_ = _stand_ins(i)
        if node[0] == "entity":
            nodes[hole] = ("entity", entity)
        if as_class[0] == "type":
            types[hole] = name
            classes[name] = class_
    return Constants(
        {**known.known, **nodes},
        {**known.types_of, **types},
        {**known.classes, **classes},
        foreign=known.foreign,
    )


def _is_closed(statement: SqlStatement | None, filling: tuple[Nodes, ...]) -> bool:
    """Return whether the holes of a statement are whole values of parameters."""
    whole = {each for i in range(len(filling)) for each in _stand_ins(i)}
    return (
        statement is not None
        and _HOLE not in statement.sql
        and not any(
            _HOLE in str(value) and value not in whole for value in statement.parameters.values()
        )
    )


def _canonical(term: Any, role: str, canonical: Canonical) -> Term:
    is_hole = isinstance(term, rdflib.URIRef) and _is_hole(term)
    return _marked(str(term), role) if is_hole else canonical(term, role)


def _filled(pattern: PartPattern, filling: Filled) -> PartPattern:
    """Return a pattern with its holes filled; one without holes is the same for all queries."""
    subject, verb, object_ = (filling.terms.get(term, term) for term in pattern.terms)
    graph = pattern.graph
    if (subject, verb, object_) == pattern.terms and not (graph is not None and _is_hole(graph)):
        return pattern
    if graph is not None and isinstance(graph, rdflib.URIRef) and _is_hole(graph):
        graph = rdflib.URIRef(filling.values[str(graph)])
    return replace(pattern, terms=(subject, verb, object_), graph=graph)


def _whole_part(
    tree: Any, names: tuple[str, ...], constants: Constants, translator: TriplePatterns
) -> QueryPart:
    calls = [each for each in nodes_in(tree) if isinstance(each, CompValue)]
    triples = [triple for each in calls if each.name == "BGP" for triple in each.triples]
    # EXISTS that is not translated has the syntax of its triples only.
    is_unknown = any(each.name == "TriplesBlock" for each in calls)
    is_open = is_unknown or any(_is_open(verb) for _, verb, _ in triples)
    properties = frozenset(constants.property(iri) for iri in iris_in(tree))
    return QueryPart(
        tree,
        names,
        [],
        projected=tuple(range(len(names))),
        properties=None if is_open else properties,
        of_tables=is_unknown
        or any(map(reads_geometry, calls))
        or any(_may_be_of_tables(triple, translator) for triple in triples),
        of_fields=any(is_of_fields(iri) or is_of_voxels(iri) for iri in properties),
    )


def _may_be_of_tables(triple: tuple[Any, Any, Any], translator: TriplePatterns) -> bool:
    """Return whether anything but single facts may match a triple pattern."""
    if isinstance(triple[1], Path):
        return True
    try:
        found = translator.sources(triple, None)
    except UntranslatedError:
        return True
    return isinstance(found, Computed) or any(each not in FACTS for each in found.maps)


def _is_open(verb: Any) -> bool:
    """Return whether a property or path can be any property, or none."""
    if isinstance(verb, (rdflib.Variable, NegatedPath)):
        return True
    if isinstance(verb, MulPath) and verb.mod in ("*", "?"):
        return True
    inner = getattr(verb, "args", None) or [getattr(verb, "arg", None), getattr(verb, "path", None)]
    return any(_is_open(each) for each in inner if isinstance(each, Path))
