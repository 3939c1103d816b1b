"""The parts of a standing query, and which changes of the map can change their solutions.

A part is triple patterns that must all match, with conditions. A solution begins or ends only if a
triple does, and the change log names its entity or statement. What has no parts is evaluated as a
whole.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count, product
from math import prod
from typing import Any, NamedTuple

import rdflib
from rdflib.paths import AlternativePath, InvPath, SequencePath
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.knowledge.facts import Fact
from semmap.knowledge.mapping import (
    COMPUTED,
    FACTS,
    INFERENCES,
    NODES,
    STATEMENTS,
    TOPOLOGICAL,
    is_mapped,
)
from semmap.knowledge.queries import plain
from semmap.knowledge.sparql.kept_queries import Row
from semmap.knowledge.sparql.stored_terms import Term
from semmap.knowledge.sparql.triple_match import MatchedPattern
from semmap.knowledge.sparql.triples import prune
from semmap.knowledge.triple_map import LETTERS, Computed, Form, TripleMap
from semmap.knowledge.vocabulary import GEO, SEMMAP
from semmap.language.expression_checker import conjuncts
from semmap.language.syntax_tree import nodes_in

SIDES = (0, 2)  # where subject and object are in a triple

Solution = dict[str, Term]  # terms of variables

_KEYS = {"entity": "{a}.id", "object_type": "{a}.id", "link": "{a}.from_id"} | dict.fromkeys(
    ("world", "placement", "connector", "room", "storey", "region"), "{a}.entity_id"
)
"""Tables of which the change log names the changed rows, by this column."""

_STATIC = frozenset({"semantic_type", "type_parent"})
"""Tables of the T-Box, whose changes are not in the log."""

_UNLIMITED = frozenset(f"{GEO}{name}" for name in TOPOLOGICAL if name.endswith(("joint", "8dc")))
"""Relations that an entity has to almost all others."""

_NOT_LOCAL = frozenset({f"{SEMMAP}reachableFrom"})
"""Relations that depend on other entities than the two."""

_VOLATILE = frozenset(
    f"Builtin_{name}" for name in ("NOW", "RAND", "UUID", "STRUUID", "BNODE", "EXISTS", "NOTEXISTS")
)
"""Functions whose value depends on more than those of the variables."""


MOST_CHOICES = 16  # a query whose paths have more choices of properties is evaluated as a whole


class WholeError(Exception):
    """A query has a part that cannot be evaluated by itself."""


@dataclass(eq=False)
class PartPattern:
    """A triple pattern of a part."""

    # subject, property and object; a variable, or the IRI that solutions have
    terms: tuple[Term, Term, Term]
    graph: Term | None  # a variable, the IRI of a named graph, or None for the default graph
    # side and form of the nodes whose change can begin or end a triple of tables
    keys: frozenset[tuple[int, Form]]
    listed: bool  # an index lists the triples of such a node
    stated: bool  # statements and inferences can match
    # a triple with these terms matches; else the database decides: it compares literals, and knows
    # whether a triple is stated or inferred
    exact: bool

    @property
    def index_key(self) -> tuple[Term | None, ...]:
        """Property, subject and object, as far as the index of patterns has them."""
        subject, verb, object_ = (None if is_variable(t) else t for t in self.terms)
        return verb, subject, object_ if isinstance(object_, rdflib.URIRef) else None

    @property
    def property(self) -> str:
        """The IRI of the property, or the name of its variable."""
        return str(self.terms[1])

    def sides(self, name: str, form: Form) -> list[int]:
        """Return where a variable is a key, with nodes of a form."""
        return [
            side
            for side in SIDES
            if (side, form) in self.keys
            and is_variable(self.terms[side])
            and name_of_variable(self.terms[side]) == name
        ]

    def match(self, quad: Fact) -> Solution | None:
        """Return the terms of the variables with which a quad matches; None if it does not."""
        found: Solution = {}
        for term, value in zip((*self.terms, self.graph), quad, strict=True):
            if term is None or value is None:
                if term is not value:
                    return None
            elif is_variable(term):
                if found.setdefault(name_of_variable(term), value) != value:
                    return None
            elif term != value and isinstance(term, rdflib.URIRef):
                return None
        return found


class Condition(NamedTuple):
    """A variable is an IRI, or is not."""

    name: str
    equal: bool
    term: Term


@dataclass(eq=False)
class QueryPart:
    """A part of a query, and its solutions."""

    tree: Any  # of the algebra
    names: tuple[str, ...]  # all variables
    # none where the part is a whole query, of which nothing else is known
    patterns: list[PartPattern]
    # patterns compare terms, and nothing else: triples that match are solutions
    plain: bool = False
    conditions: tuple[Condition, ...] = ()  # variables that are, or are not, some IRIs
    # the places of the query's variables in solutions; None: unbound
    projected: tuple[int | None, ...] = ()
    properties: frozenset[str] | None = None  # of a whole query: of its statements; None for any
    of_tables: bool = True  # a whole query has more than statements
    of_fields: bool = False  # fields answer some of a whole query
    iris: frozenset[str] = frozenset()  # of the text
    query: Any = None
    constants: Any = None  # what the IRIs of the tree stand for
    # what replaces some values of parameters
    values: Mapping[Any, Any] = field(default_factory=dict)
    # by forms of given terms, of all parts alike
    statements: dict[Any, Any] = field(default_factory=dict)
    rows: set[Row] = field(default_factory=set)  # the solutions

    def __post_init__(self) -> None:
        """Find which variables the patterns have at their ends, and where changes are named."""
        self.ends = frozenset(
            name_of_variable(p.terms[side])
            for p in self.patterns
            for side in SIDES
            if is_variable(p.terms[side])
        )
        self.is_fact = (
            self.plain
            and len(self.patterns) == 1
            and self.patterns[0].stated
            and not self.patterns[0].keys
        )  # a statement that matches is a solution
        self._shows_all = self.projected == tuple(range(len(self.names)))
        self.indexed = [(i, name) for i, name in enumerate(self.names) if name in self.ends]
        self.keyed: dict[tuple[str, Form], set[int]] = defaultdict(set)
        self.unlisted: set[str] = set()
        for number, pattern in enumerate(self.patterns):
            for side, form in pattern.keys:
                term = pattern.terms[side]
                if is_variable(term) and pattern.listed:
                    self.keyed[name_of_variable(term), form].add(number)
                elif is_variable(term):
                    self.unlisted.add(name_of_variable(term))

    def holds(self, solution: Solution) -> bool | None:
        """Return whether a solution meets all conditions; None where a term is not an IRI."""
        met = True
        for name, equal, term in self.conditions:
            found = solution.get(name)
            if not isinstance(found, rdflib.URIRef):
                return None
            met &= str.__eq__(found, term) is equal  # rdflib compares slowly
        return met

    def shown(self, row: Row) -> Row:
        """Return the variables of the query in a solution."""
        if self._shows_all:
            return row
        return tuple(None if i is None else row[i] for i in self.projected)


def is_variable(term: Any) -> bool:
    """Return whether a term of a pattern is a variable."""
    return isinstance(term, (rdflib.Variable, rdflib.BNode))


def name_of_variable(term: Any) -> str:
    """Return the name by which the translator knows a variable."""
    return str(term) if isinstance(term, rdflib.Variable) else f"_:{term}"


Sources = Callable[[tuple[Any, Any, Any], Any], MatchedPattern | Computed]
Canonical = Callable[[Any, str], Term]


def split(
    tree: Any, names: tuple[str, ...], sources: Sources, canonical: Canonical
) -> list[QueryPart] | None:
    """Return the parts of a query; None where it has to be evaluated as a whole.

    `sources` tells what can match a triple pattern with a graph, `canonical` the term that
    solutions have for a "node", "class" or "property" of the text.
    """
    node = tree
    while node.name in ("SelectQuery", "AskQuery", "Project", "Distinct", "Reduced", "OrderBy"):
        node = node.p
    try:
        return [_part(each, names, sources, canonical) for each in _alternatives(node)]
    except WholeError:
        return None


def _alternatives(node: Any) -> Iterator[Any]:
    if node.name == "Union":
        yield from _alternatives(node.p1)
        yield from _alternatives(node.p2)
    else:
        yield from _without_choices(node)


def _without_choices(node: Any) -> Iterator[Any]:
    """Yield a pattern for each choice of properties in paths; WholeError: there are very many."""
    if node.name in ("Filter", "Extend", "Graph"):
        for inner in _without_choices(node.p):
            yield CompValue(node.name, **{**node, "p": inner})
    elif node.name == "Join":
        for one, other in product(_without_choices(node.p1), _without_choices(node.p2)):
            yield CompValue("Join", p1=one, p2=other)
    elif node.name == "BGP":
        choices = [list(_choices(verb)) for _, verb, _ in node.triples]
        if prod(map(len, choices)) > MOST_CHOICES:
            raise WholeError
        for verbs in product(*choices):
            yield CompValue(
                "BGP",
                triples=[(s, v, o) for (s, _, o), v in zip(node.triples, verbs, strict=True)],
            )
    else:
        yield node


def _choices(verb: Any) -> Iterator[Any]:
    """Yield the paths without choices that a path consists of."""
    if isinstance(verb, AlternativePath):
        for each in verb.args:
            yield from _choices(each)
    elif isinstance(verb, InvPath):
        yield from map(InvPath, _choices(verb.arg))
    elif isinstance(verb, SequencePath):
        for steps in product(*map(_choices, verb.args)):
            yield SequencePath(*steps)
    else:
        yield verb


def _part(node: Any, names: tuple[str, ...], sources: Sources, canonical: Canonical) -> QueryPart:
    found = _Found()
    tree = found.rewritten(node, None)
    if not found.triples:
        raise WholeError
    matching = [sources(*each) for each in found.triples]
    ends: dict[str, list[set[Form]]] = defaultdict(list)
    for (triple, _), each in zip(found.triples, matching, strict=True):
        if isinstance(each, Computed):
            for end in filter(is_variable, (triple[side] for side in SIDES)):
                ends[name_of_variable(end)].append({"entity"})
    prune([each for each in matching if isinstance(each, MatchedPattern)], ends)
    patterns = [
        _pattern(triple, graph, each, canonical)
        for (triple, graph), each in zip(found.triples, matching, strict=True)
    ]
    known = dict.fromkeys(
        name_of_variable(term)
        for triple, graph in found.triples
        for term in (*triple, graph)
        if is_variable(term)
    ) | dict.fromkeys(found.variables)
    variables = tuple(known)
    return QueryPart(
        tree,
        variables,
        patterns,
        plain=found.plain and all(each.exact for each in patterns),
        conditions=tuple(
            Condition(each.name, each.equal, canonical(each.term, "node"))
            for each in found.conditions
        ),
        projected=tuple(variables.index(n) if n in known else None for n in names),
    )


class _Found:
    """The triple patterns of a part."""

    def __init__(self) -> None:
        self.triples: list[tuple[tuple[Any, Any, Any], Any]] = []
        self.variables: list[str] = []
        self.conditions: list[Condition] = []
        self.plain = True
        self._number = count()

    def rewritten(self, node: Any, graph: Any) -> CompValue:
        """Return the tree with sequences of properties as patterns of their own."""
        if node.name == "BGP":
            triples = [each for triple in node.triples for each in self._steps(*triple)]
            self.triples += [(triple, graph) for triple in triples]
            return CompValue("BGP", triples=triples)
        if node.name == "Graph":
            return CompValue("Graph", term=node.term, p=self._group(node.p, node.term))
        if node.name == "Join":
            parts = {key: self._group(node[key], graph) for key in ("p1", "p2")}
            return CompValue("Join", **parts)
        conditions = list(_conditions(node.expr)) if node.name == "Filter" else [None]
        self.conditions += [each for each in conditions if each]
        self.plain &= all(conditions)
        if node.name == "Filter" and not _is_volatile(node.expr):
            return CompValue("Filter", expr=node.expr, p=self.rewritten(node.p, graph))
        if node.name == "Extend" and not _is_volatile(node.expr):
            self.variables.append(str(node.var))
            inner = self.rewritten(node.p, graph)
            return CompValue("Extend", p=inner, expr=node.expr, var=node.var)
        if node.name == "ToMultiSet" and getattr(node.p, "name", "") == "values":
            self.variables += [str(name) for solution in node.p.res for name in solution]
            return node  # type: ignore[no-any-return]
        raise WholeError

    def _group(self, node: Any, graph: Any) -> CompValue:
        """Return the tree of a group, whose conditions see no variables but its own."""
        before = len(self.conditions)
        inner = self.rewritten(node, graph)
        self.plain &= len(self.conditions) == before
        return inner

    def _steps(self, subject: Any, verb: Any, object_: Any) -> Iterator[tuple[Any, Any, Any]]:
        if isinstance(verb, InvPath):
            yield from self._steps(object_, verb.arg, subject)
        elif isinstance(verb, SequencePath):
            between = [rdflib.BNode(f"step{next(self._number)}") for _ in verb.args[1:]]
            stops = [subject, *between, object_]
            for start, step, end in zip(stops, verb.args, stops[1:], strict=False):
                yield from self._steps(start, step, end)
        elif isinstance(verb, rdflib.term.Identifier):
            yield subject, verb, object_
        else:
            raise WholeError


def _conditions(tree: Any) -> Iterator[Condition | None]:
    """Yield the conditions that an expression consists of; None for one that is none of these."""
    for part in conjuncts(tree):
        found = None
        if getattr(part, "name", "") == "RelationalExpression" and part.op in ("=", "!="):
            for one, other in ((part.expr, part.other), (part.other, part.expr)):
                if isinstance(one, rdflib.Variable) and isinstance(other, rdflib.URIRef):
                    found = Condition(str(one), part.op == "=", other)
        yield found


def _is_volatile(tree: Any) -> bool:
    calls = (each for each in nodes_in(tree) if isinstance(each, CompValue))
    return any(each.name in _VOLATILE or reads_geometry(each) for each in calls)


def reads_geometry(node: CompValue) -> bool:
    """Return whether a node calls a function of our own, which reads entities."""
    return node.name == "Function" and str(node.iri).startswith(SEMMAP)


def _pattern(
    triple: tuple[Any, Any, Any],
    graph: Any,
    found: MatchedPattern | Computed,
    canonical: Canonical,
) -> PartPattern:
    subject, verb, object_ = triple
    of_class = str(verb) == str(rdflib.RDF.type)
    terms = (
        subject if is_variable(subject) else canonical(subject, "node"),
        verb if is_variable(verb) else canonical(verb, "property"),
        object_ if is_variable(object_) else canonical(object_, "class" if of_class else "node"),
    )
    named = graph if graph is None or is_variable(graph) else plain(graph)
    if isinstance(found, Computed):
        if found.property in _NOT_LOCAL:
            raise WholeError
        both = frozenset((side, "entity") for side in SIDES)
        listed = found.members is not None and found.converse is not None
        terms = (terms[0], rdflib.URIRef(found.property), terms[2])
        return PartPattern(terms, None, both, listed, stated=False, exact=True)
    tables = [each for each in found.maps if each not in FACTS]
    only_inferred = graph is None and not any(each in STATEMENTS for each in found.maps)
    if is_variable(verb) and (graph is None or tables):
        raise WholeError  # all properties of the map
    if tables and len(tables) < len(found.maps) and is_mapped(str(terms[1])):
        raise WholeError  # lists have the tables of such a property, without statements
    keys = frozenset(key for each in tables for key in _keys(each))
    return PartPattern(
        terms,
        named,
        keys,
        listed=not any(each.property in _UNLIMITED for each in tables),
        stated=len(tables) < len(found.maps),
        exact=(is_variable(object_) or isinstance(object_, rdflib.URIRef))
        and not (only_inferred and any(each in INFERENCES for each in found.maps)),
    )


def _keys(triple: TripleMap) -> Iterator[tuple[int, Form]]:
    """Yield the sides whose nodes the change log names."""
    if triple.source.tables[0] in _STATIC:
        return
    sides = []
    for letter, table in zip(LETTERS, triple.source.tables, strict=False):
        key = _KEYS.get(table)
        if key is None and "(" not in table:
            raise WholeError
        if key is not None:
            column = key.format(a=f"{{{letter}}}")
            sides += [
                (side, term.form)
                for side, term in ((0, triple.subject), (2, triple.object))
                if term.sql == column and NODES.get(term.form) and NODES[term.form].of_map
            ]
    if not sides:
        raise WholeError
    yield from sides


assert {c.property for c in COMPUTED} >= _NOT_LOCAL
