"""The closure of many facts under rules, a relation at a time.

Semi-naive evaluation (Abiteboul, Hull and Vianu, "Foundations of Databases", 1995, section 13.1):
each round joins what is new with all facts, and a join handles the rows of a relation as a set.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from semmap.knowledge.reasoning.engine import (
    SAME_AS,
    TYPE_OF,
    Node,
    Rule,
    RuleSet,
    Triple,
    Var,
    are_different,
    key_of,
    ordered,
    variables,
)

Rows = set[Any]
"""The resources of a class, or the pairs of a property."""
Row = tuple[Node, ...]


class FactIndex:
    """Facts by class and property.

    Attributes
    ----------
    rows : of a property, pairs of subject and object; of (`TYPE_OF`, class), the resources
    """

    def __init__(self) -> None:
        self.rows: defaultdict[object, Rows] = defaultdict(set)
        self._index: dict[tuple[object, int], defaultdict[Node, list[Node]]] = {}

    def __len__(self) -> int:
        return sum(map(len, self.rows.values()))

    def add(self, fact: Triple) -> None:
        """Add one fact."""
        self.extend(key_of(fact), {fact[0] if fact[1] == TYPE_OF else (fact[0], fact[2])})

    def extend(self, key: object, rows: Rows) -> None:
        """Add rows that are not there yet."""
        self.rows[key] |= rows
        for side in (0, 1):
            if (key, side) in self._index:
                _fill(self._index[key, side], rows, side)

    def by(self, verb: Node, side: int) -> defaultdict[Node, list[Node]]:
        """Return the objects of each subject (side 0), or the subjects of each object (1)."""
        found = self._index.get((verb, side))
        if found is None:
            found = self._index[verb, side] = defaultdict(list)
            _fill(found, self.rows.get(verb, ()), side)
        return found

    def triples(self) -> Iterator[Triple]:
        """Yield all facts."""
        for key, rows in self.rows.items():
            if isinstance(key, tuple):
                yield from ((row, *key) for row in rows)
            else:
                yield from ((subject, str(key), node) for subject, node in rows)


def _fill(index: defaultdict[Node, list[Node]], rows: Iterable[Any], side: int) -> None:
    for row in rows:
        index[row[side]].append(row[1 - side])


def close_all(facts: FactIndex, rules: RuleSet) -> FactIndex:
    """Add all that follows from told facts; return what was added.

    Facts that rules without a body state need not be told. Rules have no variables for properties
    and classes.
    """
    added = FactIndex()
    new: dict[object, Rows] = {}
    for rule, heads in one_step(facts, rules):
        _note(new, facts, rule, heads)
    while new:
        for key, rows in new.items():
            facts.extend(key, rows)
            added.extend(key, rows)
        last, new = new, {}
        for key, rows in last.items():
            for rule, atom, rest in rules.by_body.get(key, ()):
                _note(new, facts, rule, _heads(facts, rule, atom, rows, rest))
    return added


def one_step(facts: FactIndex, rules: RuleSet) -> Iterator[tuple[Rule, Rows]]:
    """Yield what each rule makes of told facts: the rows of its head."""
    for rule in rules.rules:
        if not rule.body:
            one = rule.head[0] if rule.head[1] == TYPE_OF else (rule.head[0], rule.head[2])
            yield rule, {one}
        elif not rule.inferred_only:
            sizes = [len(facts.rows.get(key_of(atom), ())) for atom in rule.body]
            if all(sizes):
                first = rule.body[sizes.index(min(sizes))]
                others = [atom for atom in rule.body if atom is not first]
                rest = ordered(others, variables(first))
                yield rule, _heads(facts, rule, first, facts.rows[key_of(first)], rest)


def _note(new: dict[object, Rows], facts: FactIndex, rule: Rule, heads: Rows) -> None:
    key = key_of(rule.head)
    heads = heads - facts.rows.get(key, set())
    if heads:
        new[key] = new[key] | heads if key in new else heads


def _heads(
    facts: FactIndex, rule: Rule, first: Triple, given: Rows, rest: tuple[Triple, ...]
) -> Rows:
    """Return what a rule makes of some rows of its first triple, and of all of the others."""
    if not given:
        return set()
    subject, verb, node = rule.head
    alike = all(a[1] == TYPE_OF and a[0] == subject for a in (first, *rest))
    if alike and isinstance(subject, Var):
        rows = given.intersection(*(facts.rows.get(key_of(atom), ()) for atom in rest))
        return rows if verb == TYPE_OF else {(each, node) for each in rows}
    names, found = _started(first, given)
    for atom in rest:
        if not found:
            return set()
        names, found = _joined(facts, names, found, atom)
    if rule.apart is not None:
        one, other = (names.index(name) for name in rule.apart)
        found = [row for row in found if _are_apart(row[one], row[other], clash=rule.clash)]
    left, right = _term(names, subject), _term(names, node)
    assert left is not None
    if verb == TYPE_OF:
        return {each for row in found if not isinstance(each := left(row), tuple)}
    assert right is not None
    pairs = {(a, right(row)) for row in found if not isinstance(a := left(row), tuple)}
    return {(a, b) for a, b in pairs if a != b} if verb == SAME_AS else pairs


def _are_apart(a: Node, b: Node, *, clash: bool) -> bool:
    return a != b and are_different(a, b) == clash


def _started(atom: Triple, given: Rows) -> tuple[tuple[Node, ...], list[Row]]:
    """Return the variables of a triple, and their values in given rows."""
    subject, verb, node = atom
    if verb == TYPE_OF:
        if isinstance(subject, Var):
            return (subject,), [(each,) for each in given]
        return (), [()] if subject in given else []
    if isinstance(subject, Var) and isinstance(node, Var):
        if subject == node:
            return (subject,), [(a,) for a, b in given if a == b]
        return (subject, node), list(given)
    if isinstance(subject, Var):
        return (subject,), [(a,) for a, b in given if b == node]
    if isinstance(node, Var):
        return (node,), [(b,) for a, b in given if a == subject]
    return (), [()] if (subject, node) in given else []


def _joined(
    facts: FactIndex, names: tuple[Node, ...], rows: list[Row], atom: Triple
) -> tuple[tuple[Node, ...], list[Row]]:
    """Return rows with the variables of one more triple."""
    subject, verb, node = atom
    all_of_key = facts.rows.get(key_of(atom), set())
    left, right = _term(names, subject), _term(names, node)
    if verb == TYPE_OF and left is not None:
        return names, [row for row in rows if left(row) in all_of_key]
    if left is not None and right is not None:
        return names, [row for row in rows if (left(row), right(row)) in all_of_key]
    if left is not None:
        index = facts.by(verb, 0)
        return (*names, node), [(*row, b) for row in rows for b in index.get(left(row), ())]
    if right is not None and verb != TYPE_OF:
        index = facts.by(verb, 1)
        return (*names, subject), [(*row, a) for row in rows for a in index.get(right(row), ())]
    more, values = _started(atom, all_of_key)
    return (*names, *more), [(*row, *value) for row in rows for value in values]


def _term(names: tuple[Node, ...], part: Node) -> Callable[[Row], Node] | None:
    """Return what gives the value of a term in a row; None where it has none yet."""
    if not isinstance(part, Var):
        return lambda row: part
    if part not in names:
        return None
    at = names.index(part)
    return lambda row: row[at]
