"""The triples of touched entities that standing queries have patterns of.

Facts of tables are read first. Relations of surfaces are computed only for entities that have what
else the queries need, and only to those that queries name.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import psycopg
import rdflib
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.knowledge.facts import Fact
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import COMPUTED
from semmap.knowledge.sparql.constants import Constants
from semmap.knowledge.sparql.stored_terms import Term, term_of
from semmap.knowledge.sparql.translator import GIVEN, translate_each
from semmap.knowledge.standing.changes import Touched
from semmap.knowledge.standing.index import COSTLY, Key, PatternIndex, Triples
from semmap.knowledge.standing.parts import (
    SIDES,
    PartPattern,
    QueryPart,
    Solution,
    is_variable,
    name_of_variable,
)
from semmap.knowledge.triple_map import Form

_COMPUTED = {each.property: each for each in COMPUTED}


class Asked(NamedTuple):
    """Lists that the database was asked for."""

    keys: list[Key]
    rows: psycopg.Cursor[Any]


class TripleLists:
    """Lists triples of entities; the statements are kept."""

    def __init__(self) -> None:
        self._statements: dict[Any, tuple[bytes, dict[str, Any]]] = {}

    def ask(self, view: MapView, ids: list[int], index: PatternIndex) -> Asked | None:
        """Ask what is true of entities, of all properties of tables that patterns have."""
        facts = sorted(key for key in index.listed if key[0] not in COSTLY)
        return self._ask(view, dict.fromkeys(facts, (ids, None))) if ids else None

    def of(
        self,
        view: MapView,
        touched: Touched,
        facts: Asked | None,
        index: PatternIndex,
        constants: Constants,
    ) -> Triples:
        """Return what is true of touched entities, of all properties that patterns have."""
        known: Triples = defaultdict(list)
        _read(facts, touched, known)
        costly = {}
        for key in sorted(key for key in index.listed if key[0] in COSTLY) if touched.ids else ():
            wanted = _wanted(key, index, touched, known, constants)
            if wanted[0]:
                costly[key] = wanted
        _read(self._ask(view, costly), touched, known)
        return known

    def _ask(
        self, view: MapView, lists: Mapping[Key, tuple[list[int], list[int] | None]]
    ) -> Asked | None:
        """Ask lists of triples of some entities, with some other ends, or any."""
        if not lists:
            return None
        lists_of = tuple((key, others is None) for key, (_, others) in lists.items())
        shape = lists_of, view.inferred
        if shape not in self._statements:
            self._statements[shape] = _statement(view, lists_of)
        sql, values = self._statements[shape]
        values = dict(values)
        for i, (ids, others) in enumerate(lists.values()):
            values |= {f"ids{i}": ids, f"others{i}": others}
        return Asked(list(lists), view.session.execute(sql, values, prepare=True))


def _read(asked: Asked | None, touched: Touched, known: Triples) -> None:
    if asked is None:
        return
    for k, number, text, tag in asked.rows.fetchall():
        verb, side, form = asked.keys[k]
        if number not in touched.names:
            continue
        term, other = touched.node(number, form), term_of(text, tag)
        if other is not None:
            ends = (term, other) if side == 0 else (other, term)
            known[verb, side, term].append(Fact(ends[0], rdflib.URIRef(verb), ends[1]))


def _wanted(
    key: Key, index: PatternIndex, touched: Touched, known: Triples, constants: Constants
) -> tuple[list[int], list[int] | None]:
    """Return of which changed entities a costly list matters, and which other ends; None: any."""
    _, _, form = key
    ids: list[int] = []
    others: set[Term | None] = set()
    for number in sorted(touched.ids & touched.names.keys()):
        term = touched.node(number, form)
        for needed, ends in index.listed[key].items():
            if all(
                any(end in (None, quad[2 - side]) for quad in known.get((verb, side, term), ()))
                for verb, side, end in needed
            ):
                ids.append(number)
                others |= ends.keys()
    nodes = (constants.node(str(each)) for each in others if each is not None)
    numbers = sorted({number for kind, number in nodes if kind == "entity"})
    return list(dict.fromkeys(ids)), None if None in others else numbers


def _statement(view: MapView, lists: Iterable[tuple[Key, bool]]) -> tuple[bytes, dict[str, Any]]:
    """Return the statement of lists, each with or without any other end, and its parameters."""
    parts: list[str] = []
    values: dict[str, Any] = {}
    for i, ((verb, side, form), any_end) in enumerate(lists):
        ids = f"%(ids{i})s::bigint[]"
        computed = _COMPUTED.get(verb)
        if computed is not None:
            function = computed.converse if side == 0 else computed.members
            assert function is not None
            values["namespace"] = view.namespace
            limit = "" if any_end else f" WHERE f.member = ANY (%(others{i})s::bigint[])"
            parts.append(
                f"SELECT {i}, p.n, %(namespace)s::text || iri_encode(e.name), 'I'::text "
                f"FROM unnest({ids}) p (n), LATERAL {function.format(a='p.n', b='p.n')} f (member) "
                f"JOIN entity e ON e.id = f.member{limit}"
            )
            continue
        ends = ("key", "other") if side == 0 else ("other", "key")
        triple = (rdflib.Variable(ends[0]), rdflib.URIRef(verb), rdflib.Variable(ends[1]))
        pattern = CompValue("BGP", triples=[triple])
        source = view.graph(Constants({}))
        statement = translate_each(pattern, ("other",), source, {"key": form})
        sql = statement.sql.replace("%(", f"%(k{i}")
        sql = sql.replace(GIVEN, f"unnest({ids}, {ids}) AS p (n, s0)")
        parts.append(f"SELECT {i}, q.* FROM ({sql}) q")
        values |= {f"k{i}{name}": value for name, value in statement.parameters.items()}
    return " UNION ALL ".join(parts).encode(), values


def joined(
    part: QueryPart,
    region: Solution,
    left: Iterable[int],
    known: Triples,
    touched: Touched,
    index: PatternIndex,
) -> list[Solution] | None:
    """Return the solutions of a plain part with some terms; None where lists do not tell them.

    The patterns `left` are not known to match; `known` has all listed triples of touched nodes.
    """
    solutions, waiting = [region], [part.patterns[n] for n in left]
    while waiting and solutions:
        pattern = next((p for p in waiting if _list_of(p, solutions[0], touched, index)), None)
        if pattern is None:
            return None
        waiting.remove(pattern)
        more: list[Solution] = []
        for solution in solutions:
            key = _list_of(pattern, solution, touched, index)
            if key is None:
                return None
            more += _extended(solution, pattern, known.get(key, ()))
        solutions = more
    met = []
    for solution in solutions:
        holds = part.holds(solution)
        if holds is None:
            return None
        if holds:
            met.append(solution)
    return met


def _extended(
    solution: Solution, pattern: PartPattern, quads: Iterable[Fact]
) -> Iterator[Solution]:
    """Yield a solution with the terms of each triple that matches a pattern and fits."""
    for quad in quads:
        match = pattern.match(quad)
        if match is not None and all(solution.get(n, t) == t for n, t in match.items()):
            yield solution | match


def _list_of(
    pattern: PartPattern, solution: Solution, touched: Touched, index: PatternIndex
) -> tuple[str, int, Term] | None:
    """Return the key of a list with all triples that match a pattern with some terms."""
    if pattern.graph is not None or not pattern.listed or pattern.property in COSTLY:
        return None
    for side in SIDES:
        end = pattern.terms[side]
        term = solution.get(name_of_variable(end)) if is_variable(end) else None
        if term is not None and term in touched.nodes:
            form = touched.nodes[term][0]
            if (side, form) in pattern.keys and (pattern.property, side, form) in index.listed:
                return pattern.property, side, term
    return None


def has_all(part: QueryPart, name: str, form: Form, term: Term, known: Triples) -> bool:
    """Return whether a node has a listed triple for each pattern that needs one."""
    for number in part.keyed[name, form]:
        pattern = part.patterns[number]
        found = (
            solution
            for side in pattern.sides(name, form)
            for solution in _extended({}, pattern, known.get((pattern.property, side, term), ()))
        )
        if next(found, None) is None:
            return False
    return True


def may_match(
    part: QueryPart, number: int, solution: Solution, known: Triples, touched: Touched
) -> bool:
    """Return whether the other patterns may match, by what is known of the touched entities."""
    for other, pattern in enumerate(part.patterns):
        verb = str(pattern.terms[1])
        if other == number or not pattern.listed or verb in COSTLY:
            continue
        for side, form in pattern.keys:
            end = pattern.terms[side]
            term = solution.get(name_of_variable(end)) if is_variable(end) else None
            if term is None or touched.nodes.get(term, ("", 0))[0] != form:
                continue
            found = _extended(solution, pattern, known.get((verb, side, term), ()))
            if next(found, None) is None:
                return False
    return True
