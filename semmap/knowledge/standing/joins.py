"""What the listed triples of changed entities tell of the solutions of a part."""

from __future__ import annotations

from collections.abc import Iterable

from semmap.knowledge.sparql.kept_queries import Term
from semmap.knowledge.standing.changes import Touched
from semmap.knowledge.standing.index import COSTLY, PatternIndex, Triples
from semmap.knowledge.standing.parts import (
    SIDES,
    PartPattern,
    QueryPart,
    Solution,
    is_variable,
    name_of_variable,
)
from semmap.knowledge.triple_map import Form


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
        more = []
        for solution in solutions:
            key = _list_of(pattern, solution, touched, index)
            if key is None:
                return None
            for quad in known.get(key, ()):
                match = pattern.match(quad)
                if match is not None and all(solution.get(n, t) == t for n, t in match.items()):
                    more.append(solution | match)
        solutions = more
    met = []
    for solution in solutions:
        holds = [condition.holds(solution) for condition in part.conditions]
        if None in holds:
            return None
        if all(holds):
            met.append(solution)
    return met


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
            pattern.match(quad)
            for side in pattern.sides(name, form)
            for quad in known.get((pattern.property, side, term), ())
        )
        if all(match is None for match in found):
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
            found = (pattern.match(quad) for quad in known.get((verb, side, term), ()))
            if not any(
                match is not None and all(solution.get(n, t) == t for n, t in match.items())
                for match in found
            ):
                return False
    return True
