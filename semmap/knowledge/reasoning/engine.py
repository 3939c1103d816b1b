"""Materialised Datalog on triples: closure by semi-naive evaluation, retraction by DRed.

DRed is delete and rederive (Gupta, Mumick and Subrahmanian, "Maintaining Views Incrementally",
SIGMOD 1993, section 7).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

from semmap.knowledge.vocabulary import OWL, RDF, XSD

Node = int | str | tuple[str, str]  # the id of an entity, an IRI, or a literal as text and tag

Triple = tuple[Node, Node, Node]

TYPE_OF = f"{RDF}type"
SAME_AS = f"{OWL}sameAs"
_NUMBERS = frozenset(f"{XSD}{name}" for name in ("integer", "decimal", "double", "float"))


AT_ONCE = 64
"""Of so many objects, facts are read in one go: the next triple of a rule is about them."""


class Var(str):
    """A variable of a rule."""

    __slots__ = ()


@dataclass(frozen=True)
class Rule:
    """A rule: where all triples of the body are facts, the head is one, too."""

    name: str  # in OWL 2 Profiles, section 4.3
    # body, head: triples with variables
    body: tuple[Triple, ...]
    head: Triple
    text: str  # the axiom in words
    apart: tuple[Var, Var] | None = None  # two variables that must be different terms
    # the two variables must be known to be different resources; else not known to be so
    clash: bool = False
    # facts told of entities need not be considered: what follows is told, too
    inferred_only: bool = False


Bindings = dict[str, Node]


class Facts:
    """Triples with an index for each bound side, which a subclass reads when they are needed."""

    def __init__(self) -> None:
        self._objects: defaultdict[tuple[Node, Node], set[Node]] = defaultdict(set)
        self._subjects: defaultdict[tuple[Node, Node], set[Node]] = defaultdict(set)
        self._verbs_of: defaultdict[Node, set[Node]] = defaultdict(set)
        self._verbs_to: defaultdict[Node, set[Node]] = defaultdict(set)
        self._told: set[Triple] = set()

    def __contains__(self, fact: Triple) -> bool:
        self.need_subject(fact[0])
        return fact[2] in self._objects.get((fact[0], fact[1]), ())

    def need_subject(self, subject: Node) -> None:
        """Read the facts of a subject."""

    def need_subjects(self, subjects: Iterable[Node]) -> None:
        """Read the facts of several subjects at once."""

    def need_object(self, verb: Node | None, node: Node) -> None:
        """Read the facts with an object, of a property or of all."""

    def need_verb(self, verb: Node | None) -> None:
        """Read the facts of a property, or all."""

    def is_told(self, fact: Triple) -> bool:
        """Return whether a fact is stated, whatever it follows from."""
        return fact in self._told

    def all(self) -> Iterator[Triple]:
        """Yield what is in memory."""
        for (subject, verb), objects in self._objects.items():
            yield from ((subject, verb, node) for node in objects)

    def add(self, fact: Triple, *, told: bool = False) -> None:
        """Add a fact; one that is told stays so."""
        subject, verb, node = fact
        self._objects[subject, verb].add(node)
        self._subjects[verb, node].add(subject)
        self._verbs_of[subject].add(verb)
        self._verbs_to[node].add(verb)
        if told:
            self._told.add(fact)

    def untell(self, fact: Triple) -> None:
        """Let a fact be no longer stated."""
        self._told.discard(fact)

    def remove(self, fact: Triple) -> None:
        """Remove a fact."""
        subject, verb, node = fact
        self._objects[subject, verb].discard(node)
        self._subjects[verb, node].discard(subject)
        self._told.discard(fact)

    def match(self, subject: Node | None, verb: Node | None, node: Node | None) -> Iterable[Triple]:
        """Return the facts with given terms, None for any: a list, so that facts may be added."""
        if subject is not None:
            self.need_subject(subject)
            if verb is not None:
                found = self._objects.get((subject, verb), ())
                if node is not None:
                    return [(subject, verb, node)] if node in found else []
                return [(subject, verb, each) for each in found]
            verbs = list(self._verbs_of.get(subject, ()))
            return [f for each in verbs for f in self.match(subject, each, node)]
        if node is None:
            self.need_verb(verb)
            every = (f for f in self.all() if verb is None or f[1] == verb)
            return list(every)
        self.need_object(verb, node)
        if verb is not None:
            return [(each, verb, node) for each in self._subjects.get((verb, node), ())]
        verbs = list(self._verbs_to.get(node, ()))
        return [(each, v, node) for v in verbs for each in self._subjects.get((v, node), ())]


class RuleSet:
    """Rules, by the facts that they are about."""

    def __init__(self, rules: Iterable[Rule]) -> None:
        self.rules = tuple(dict.fromkeys(rules))
        self.by_body: defaultdict[object, list[tuple[Rule, Triple, tuple[Triple, ...]]]]
        self.by_body = defaultdict(list)
        self._by_head: defaultdict[object, list[tuple[Rule, tuple[Triple, ...]]]]
        self._by_head = defaultdict(list)
        for rule in self.rules:
            backwards = ordered(rule.body, variables(rule.head))
            self._by_head[key_of(rule.head)].append((rule, backwards))
            for i, atom in enumerate(rule.body):
                rest = ordered(rule.body[:i] + rule.body[i + 1 :], variables(atom))
                self.by_body[key_of(atom)].append((rule, atom, rest))

    def __len__(self) -> int:
        return len(self.rules)

    def consequences(self, facts: Facts, fact: Triple) -> Iterator[tuple[Rule, Triple]]:
        """Yield what follows from a fact and others, with the rules."""
        told: bool | None = None
        for key in _keys(fact):
            for rule, atom, rest in self.by_body.get(key, ()):
                if rule.inferred_only and isinstance(fact[0], int):
                    told = facts.is_told(fact) if told is None else told
                    if told:
                        continue
                start = _unified(atom, fact, {})
                if start is None:
                    continue
                for bindings in solutions(facts, rest, start) if rest else (start,):
                    if rule.apart is None or _allowed(rule.apart, bindings, clash=rule.clash):
                        head = filled(rule.head, bindings)
                        is_trivial = head[1] == SAME_AS and head[0] == head[2]
                        if not is_trivial and not isinstance(head[0], tuple):
                            yield rule, head

    def reasons(self, facts: Facts, fact: Triple) -> Iterator[tuple[Rule, tuple[Triple, ...]]]:
        """Yield the rules, and the facts, from which a fact follows in one step."""
        for key in _keys(fact):
            for rule, body in self._by_head.get(key, ()):
                start = _unified(rule.head, fact, {})
                if start is None:
                    continue
                for bindings in solutions(facts, body, start):
                    if rule.apart is None or _allowed(rule.apart, bindings, clash=rule.clash):
                        yield rule, tuple(filled(atom, bindings) for atom in rule.body)


def close(facts: Facts, rules: RuleSet, new: Iterable[Triple]) -> None:
    """Add all that follows from new facts, which `facts` has already."""
    queue = list(new)
    while queue:
        fact = queue.pop()
        for _, head in rules.consequences(facts, fact):
            if head not in facts:
                facts.add(head)
                queue.append(head)


def retract(
    facts: Facts, rules: RuleSet, gone: Collection[Triple]
) -> tuple[set[Triple], set[Triple]]:
    """Remove what follows only from facts `gone`, told no longer; return what was removed.

    Facts among `gone` may be facts still, as inferences: these are returned, too.
    """
    over = dict.fromkeys(gone)
    queue = list(over)
    while queue:
        fact = queue.pop()
        for _, head in rules.consequences(facts, fact):
            if head not in over and head in facts and not facts.is_told(head):
                over[head] = None
                queue.append(head)
    for fact in over:
        facts.remove(fact)
    again = [fact for fact in over if next(rules.reasons(facts, fact), None) is not None]
    for fact in again:
        facts.add(fact)
    close(facts, rules, again)
    removed = {fact for fact in over if fact not in facts}
    return removed, set(gone) - removed


def key_of(atom: Triple) -> object:
    """Return under which key the facts are that can match: the property, of types the class."""
    _, verb, node = atom
    if isinstance(verb, Var):
        return None
    if verb == TYPE_OF and not isinstance(node, Var):
        return (verb, node)
    return verb


def _keys(fact: Triple) -> tuple[object, ...]:
    _, verb, node = fact
    return ((verb, node), verb, None) if verb == TYPE_OF else (verb, None)


def variables(atom: Triple) -> frozenset[str]:
    """Return the variables of a triple."""
    return frozenset(part for part in atom if isinstance(part, Var))


def ordered(atoms: Sequence[Triple], known: frozenset[str]) -> tuple[Triple, ...]:
    """Return triples so that each has as many known terms as possible."""
    left, found = list(atoms), []
    while len(left) > 1:
        best = min(left, key=lambda atom: len(variables(atom) - known))
        left.remove(best)
        found.append(best)
        known |= variables(best)
    return (*found, *left)


def _unified(atom: Triple, fact: Triple, bindings: Bindings) -> Bindings | None:
    """Return bindings with which a triple is a fact."""
    found = bindings.copy()
    for part, term in zip(atom, fact, strict=True):
        # Not isinstance: this runs for each fact and rule.
        if part.__class__ is Var:
            if found.setdefault(part, term) != term:
                return None
        elif part != term:
            return None
    return found


def solutions(facts: Facts, atoms: tuple[Triple, ...], bindings: Bindings) -> Iterator[Bindings]:
    """Yield the bindings, more than some, with which all triples are facts."""
    if not atoms:
        yield bindings
        return
    first, rest = atoms[0], atoms[1:]
    subject, verb, node = [bindings.get(p) if p.__class__ is Var else p for p in first]
    if subject is not None and verb is not None and node is not None:
        if (subject, verb, node) in facts:
            yield from solutions(facts, rest, bindings)
        return
    matches = list(facts.match(subject, verb, node))
    for i, fact in enumerate(matches):
        if rest and i % AT_ONCE == 0 and len(matches) > 1:
            facts.need_subjects(f[2] for f in matches[i : i + AT_ONCE])
        found = _unified(first, fact, bindings)
        if found is not None:
            yield from solutions(facts, rest, found)


def filled(atom: Triple, bindings: Bindings) -> Triple:
    """Return a triple with the terms of its variables."""
    subject, verb, node = [bindings.get(p, p) if p.__class__ is Var else p for p in atom]
    return subject, verb, node


def _allowed(apart: tuple[Var, Var], bindings: Bindings, *, clash: bool) -> bool:
    a, b = (bindings[name] for name in apart)
    return a != b and are_different(a, b) == clash


def are_different(a: Node, b: Node) -> bool:
    """Return whether two terms are known to differ: entities by name, literals by value."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        return _value(a) != _value(b)
    if isinstance(a, tuple) or isinstance(b, tuple):
        return True
    return isinstance(a, int) and isinstance(b, int) and a != b


def _value(literal: tuple[str, str]) -> object:
    text, tag = literal
    if tag in _NUMBERS:
        try:
            return Decimal(text)
        except InvalidOperation:
            return literal
    if tag == f"{XSD}boolean":
        return {"1": "true", "0": "false"}.get(text, text), tag
    return literal
