"""Which parts of standing queries a triple can concern: Rete's network of alpha memories.

A part is found by the pattern that fewest triples match: of those about one variable, that which
has a constant. So a change is not compared with each of a thousand queries.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

import rdflib

from semmap.knowledge.facts import Fact
from semmap.knowledge.mapping import COMPUTED, TOPOLOGICAL
from semmap.knowledge.sparql.stored_terms import Term
from semmap.knowledge.standing.parts import (
    SIDES,
    PartPattern,
    QueryPart,
    is_variable,
    name_of_variable,
)
from semmap.knowledge.triple_map import Form
from semmap.knowledge.vocabulary import GEO

COSTLY = frozenset(c.property for c in COMPUTED) | {f"{GEO}{name}" for name in TOPOLOGICAL}
"""Properties that are computed: they are listed for changed entities only, where it matters."""

Key = tuple[str, int, Form]
"""A property, and the side and the form of the nodes of which triples are listed."""

Triples = dict[tuple[str, int, Term], list[Fact]]
"""Listed triples by property, and side and term of their node."""

Needed = tuple[str, int, Term | None]
"""A property, the side of a node, and the other end; None for any."""

_Path = tuple[Any, ...]


class PatternIndex:
    """Finds parts by triples."""

    def __init__(self) -> None:
        self.listed: dict[Key, dict[frozenset[Needed], dict[Term | None, Any]]] = {}
        self.fixed: dict[Term, dict[QueryPart, None]] = {}
        self.unlisted: dict[QueryPart, None] = {}
        self._keyed: dict[Any, Any] = {}
        self._stated: dict[Any, Any] = {}
        self._ground: dict[Any, Any] = {}
        self._paths: dict[QueryPart, list[tuple[dict[Any, Any], _Path]]] = {}

    def insert(self, part: QueryPart) -> None:
        """Put the patterns of a part into the index."""
        paths = dict.fromkeys(self._places(part))
        self._paths[part] = [(getattr(self, name), path) for name, path in paths]
        for tree, path in self._paths[part]:
            for key in path[:-1]:
                tree = tree.setdefault(key, {})
            tree[path[-1]] = None

    def remove(self, part: QueryPart) -> None:
        """Remove the patterns of a part."""
        for tree, path in self._paths.pop(part, ()):
            _drop(tree, path)

    def _places(self, part: QueryPart) -> Iterator[tuple[str, _Path]]:
        if part.unlisted:
            yield "unlisted", (part,)
        for (name, form), numbers in part.keyed.items():
            first = min(numbers, key=lambda n: _generality(part.patterns[n]))
            pattern = part.patterns[first]
            for side in pattern.sides(name, form):
                yield "_keyed", (side, form, pattern.index_key, (part, name, first))
        for number, pattern in enumerate(part.patterns):
            for side, form in pattern.keys:
                term = pattern.terms[side]
                if not is_variable(term):
                    yield "fixed", (term, part)
                elif pattern.listed:
                    key = (pattern.property, side, form)
                    yield "listed", (key, *_listed_for(part, pattern, side, form), (part, number))
            if pattern.stated:
                member = (part, number)
                yield "_stated", (pattern.index_key, *_told_apart(part, pattern), member)
                if not any(is_variable(pattern.terms[side]) for side in SIDES):
                    yield "_ground", (pattern.index_key, member)

    def keyed(self, quad: Fact, side: int, form: Form) -> Iterator[tuple[QueryPart, str, int]]:
        """Yield the parts that a listed triple may concern, with variable and pattern."""
        index = self._keyed.get(side, {}).get(form)
        if index:
            for key in _keys_of(quad):
                yield from index.get(key, ())

    def stated(
        self, quad: Fact, known: Triples, nodes: Mapping[Term, tuple[Form, int]]
    ) -> Iterator[tuple[QueryPart, int]]:
        """Yield the parts that a new statement may concern; nodes are all listed in `known`."""
        for key in _keys_of(quad):
            for told_apart, members in self._stated.get(key, {}).items():
                if told_apart is not None:
                    side, (verb, of, form) = told_apart
                    term: Any = quad[side]
                    if nodes.get(term, ("", 0))[0] == form:
                        for other in known.get((verb, of, term), ()):
                            yield from members.get(other[2 - of], ())
                        continue
                for some in members.values():
                    yield from some

    def ground(self, quad: Fact) -> Iterator[tuple[QueryPart, int]]:
        """Yield the parts with a pattern without variables that a statement may concern."""
        for key in _keys_of(quad):
            yield from self._ground.get(key, ())


def _generality(pattern: PartPattern) -> tuple[bool, bool]:
    """Return a key that sorts patterns by how many triples match."""
    constants = sum(isinstance(pattern.terms[side], rdflib.URIRef) for side in SIDES)
    return not constants, pattern.property in COSTLY


def _listed_for(
    part: QueryPart, pattern: PartPattern, side: int, form: Form
) -> tuple[frozenset[Needed], Term | None]:
    """Return which other triples a node needs, and which other end of this one."""
    if pattern.property not in COSTLY:
        return frozenset(), None
    name = name_of_variable(pattern.terms[side])
    needed = set()
    for number in part.keyed[name, form]:
        other = part.patterns[number]
        sides = other.sides(name, form)
        if other.property not in COSTLY and len(sides) == 1:
            far = other.terms[2 - sides[0]]
            needed.add((other.property, sides[0], far if isinstance(far, rdflib.URIRef) else None))
    end = pattern.terms[2 - side]
    return frozenset(needed), None if is_variable(end) else end


def _told_apart(part: QueryPart, pattern: PartPattern) -> tuple[Any, Term | None]:
    """Return the listed triple of an end of a statement by which parts are told apart.

    It is a side of the statement, with property, side and form of the triple; and the other end of
    this, a constant.
    """
    for side in SIDES:
        end = pattern.terms[side]
        if not is_variable(end) or is_variable(pattern.terms[1]):
            continue
        name = name_of_variable(end)
        for (variable, form), numbers in part.keyed.items():
            if variable != name:
                continue
            for other in (part.patterns[n] for n in sorted(numbers)):
                sides = other.sides(name, form)
                if other is pattern or len(sides) != 1 or other.property in COSTLY:
                    continue
                constant = other.terms[2 - sides[0]]
                if isinstance(constant, rdflib.URIRef):
                    return (side, (other.property, sides[0], form)), constant
    return None, None


def _keys_of(quad: Fact) -> Iterator[tuple[Term | None, ...]]:
    return product((quad.property, None), (quad.subject, None), (quad.object, None))


def _drop(tree: dict[Any, Any], path: _Path) -> None:
    key, *rest = path
    if rest:
        _drop(tree[key], tuple(rest))
    if not rest or not tree[key]:
        del tree[key]
