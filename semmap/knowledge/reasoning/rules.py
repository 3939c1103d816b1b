"""The rules of OWL 2 RL (Profiles, section 4.3, tables 4 to 9), filled with the axioms of a map."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

from semmap.knowledge.reasoning.engine import (
    SAME_AS,
    TYPE_OF,
    Facts,
    Node,
    Rule,
    RuleSet,
    Triple,
    Var,
)
from semmap.knowledge.vocabulary import OWL, RDF, RDFS, SEMMAP

CONTRADICTION = f"{SEMMAP}contradiction"
"""The property of what is inconsistent; its value is the axiom in words."""
STRING = "http://www.w3.org/2001/XMLSchema#string"
SUB, SUB_PROPERTY = f"{RDFS}subClassOf", f"{RDFS}subPropertyOf"
DOMAIN, RANGE = f"{RDFS}domain", f"{RDFS}range"

_AXIOMS = (
    ("equivalentClass", "disjointWith", "complementOf", "intersectionOf", "unionOf", "oneOf"),
    ("onProperty", "someValuesFrom", "allValuesFrom", "hasValue", "onClass", "hasKey"),
    ("maxCardinality", "maxQualifiedCardinality", "equivalentProperty", "inverseOf"),
    ("propertyDisjointWith", "propertyChainAxiom", "members", "distinctMembers"),
    ("sourceIndividual", "assertionProperty", "targetIndividual", "targetValue"),
)
AXIOM_PROPERTIES = frozenset(
    {SUB, SUB_PROPERTY, DOMAIN, RANGE, f"{RDF}first", f"{RDF}rest"}
    | {f"{OWL}{name}" for names in _AXIOMS for name in names}
)
"""Facts with these properties are axioms."""

_KINDS = (
    ("FunctionalProperty", "InverseFunctionalProperty", "IrreflexiveProperty"),
    ("SymmetricProperty", "AsymmetricProperty", "TransitiveProperty", "AllDisjointClasses"),
    ("AllDisjointProperties", "AllDifferent", "NegativePropertyAssertion"),
)
AXIOM_CLASSES = frozenset(f"{OWL}{name}" for names in _KINDS for name in names)
"""To be of these classes is an axiom."""

X, Y, Z, A, B, P, V = map(Var, "xyzabpv")


def _schema(name: str, head: Triple, *body: Triple) -> Rule:
    return Rule(name, body, head, name)


def _owl(name: str) -> str:
    return f"{OWL}{name}"


def _restricted(name: str, part: str) -> Rule:
    """Return the rule by which a restriction follows from one with a narrower class."""
    body = tuple((c, _owl("onProperty"), P) for c in (X, Y))
    parts = ((X, _owl(part), A), (Y, _owl(part), B), (A, SUB, B))
    return Rule(name, body + parts, (X, SUB, Y), name)


def _restricted_property(name: str, part: str, *, wider: bool) -> Rule:
    body = ((X, _owl("onProperty"), P), (Y, _owl("onProperty"), V), (P, SUB_PROPERTY, V))
    parts = ((X, _owl(part), A), (Y, _owl(part), A))
    return Rule(name, body + parts, (X, SUB, Y) if wider else (Y, SUB, X), name)


def _alike(part: str) -> Rule:
    """Return the rule by which two equal restrictions are one class."""
    body = ((X, _owl("onProperty"), P), (Y, _owl("onProperty"), P))
    return Rule("scm-cls", (*body, (X, _owl(part), A), (Y, _owl(part), A)), (X, SUB, Y), "", (X, Y))


_CHAINS = ("scm-sco", "scm-spo")
SCHEMA_RULES: tuple[Rule, ...] = (
    _schema("scm-sco", (X, SUB, Z), (X, SUB, Y), (Y, SUB, Z)),
    _schema("scm-eqc1", (X, SUB, Y), (X, _owl("equivalentClass"), Y)),
    _schema("scm-eqc1", (Y, SUB, X), (X, _owl("equivalentClass"), Y)),
    _schema("scm-eqc2", (X, _owl("equivalentClass"), Y), (X, SUB, Y), (Y, SUB, X)),
    _schema("scm-spo", (X, SUB_PROPERTY, Z), (X, SUB_PROPERTY, Y), (Y, SUB_PROPERTY, Z)),
    _schema("scm-eqp1", (X, SUB_PROPERTY, Y), (X, _owl("equivalentProperty"), Y)),
    _schema("scm-eqp1", (Y, SUB_PROPERTY, X), (X, _owl("equivalentProperty"), Y)),
    _schema(
        "scm-eqp2",
        (X, _owl("equivalentProperty"), Y),
        (X, SUB_PROPERTY, Y),
        (Y, SUB_PROPERTY, X),
    ),
    _schema("scm-dom1", (P, DOMAIN, Y), (P, DOMAIN, X), (X, SUB, Y)),
    _schema("scm-dom2", (P, DOMAIN, X), (V, DOMAIN, X), (P, SUB_PROPERTY, V)),
    _schema("scm-rng1", (P, RANGE, Y), (P, RANGE, X), (X, SUB, Y)),
    _schema("scm-rng2", (P, RANGE, X), (V, RANGE, X), (P, SUB_PROPERTY, V)),
    _restricted("scm-svf1", "someValuesFrom"),
    _restricted("scm-avf1", "allValuesFrom"),
    *(_alike(part) for part in ("someValuesFrom", "allValuesFrom", "hasValue")),
    _restricted_property("scm-svf2", "someValuesFrom", wider=True),
    _restricted_property("scm-avf2", "allValuesFrom", wider=False),
    _restricted_property("scm-hv", "hasValue", wider=True),
)
"""Table 9. What it has of each class and property itself is left out."""


@dataclass(frozen=True)
class Compiled:
    """The rules of a set of axioms."""

    rules: RuleSet  # those without a body state what follows from axioms alone
    classes: frozenset[Node]  # of which rules are, beside those that only inferences meet
    heads: frozenset[Node]  # classes that rules infer
    # that rules are about; None: all, because terms may be the same resource
    properties: frozenset[Node] | None

    def stated(self) -> list[Triple]:
        """Return what follows from the axioms alone."""
        return [rule.head for rule in self.rules.rules if not rule.body]


def compile_rules(
    axioms: Iterable[Triple],
    show: Callable[[Node], str] = str,
    *,
    built_in: frozenset[tuple[Node, Node]] = frozenset(),
    single: Callable[[str], bool] = lambda iri: False,
    same: bool | None = None,
) -> Compiled:
    """Return the rules of axioms; `show` names their terms in texts.

    Types are told with the `built_in` pairs of a class and a superclass already. All values of a
    `single` property are entities or literals, so that two are never one resource. `same`: with the
    rules of equality; None: if a rule infers ``owl:sameAs``.
    """
    facts = Facts()
    given = set(axioms)
    for fact in given:
        facts.add(fact)
    parts = [(c, SUB, part) for c, items in _lists(facts, "intersectionOf") for part in items]
    parts += [(part, SUB, c) for c, items in _lists(facts, "unionOf") for part in items]
    for fact in parts:
        facts.add(fact)
    # What the transitivity of subsumption adds is for queries: rules find it step by step.
    direct = {f for f in given if f[1] in (SUB, SUB_PROPERTY)}
    direct |= _steps(facts, given)
    made = _Compiler(facts, show, direct, built_in, single)
    rules = list(made.rules())
    if any(rule.head[1] == SAME_AS for rule in rules) if same is None else same:
        rules += _same_as()
    heads_and_bodies = [atom for rule in rules for atom in (*rule.body, rule.head)]
    classes = frozenset(
        atom[2]
        for rule in rules
        if not rule.inferred_only
        for atom in rule.body
        if atom[1] == TYPE_OF and not isinstance(atom[2], Var)
    )
    heads = frozenset(r.head[2] for r in rules if r.head[1] == TYPE_OF)
    everything = any(isinstance(atom[1], Var) for atom in heads_and_bodies)
    properties = frozenset(atom[1] for atom in heads_and_bodies) - {CONTRADICTION}
    rules += (
        Rule("table 9", (), f, "axioms about classes and properties")
        for f in facts.all()
        if f not in given and f[0] != f[2] and (f[0], f[2]) not in built_in
    )
    return Compiled(RuleSet(rules), classes, heads, None if everything else properties)


def _lists(facts: Facts, name: str) -> Iterator[tuple[Node, list[Node]]]:
    """Yield the subjects of a property of lists, with the members."""
    for subject, _, node in sorted(facts.match(None, _owl(name), None), key=str):
        items: list[Node] = []
        seen = set()
        while node != f"{RDF}nil" and node not in seen:
            seen.add(node)
            items += (first for _, _, first in facts.match(node, f"{RDF}first", None))
            rests = [rest for _, _, rest in facts.match(node, f"{RDF}rest", None)]
            node = rests[0] if rests else f"{RDF}nil"
        yield subject, items


def _steps(facts: Facts, given: set[Triple]) -> set[Triple]:
    """Close axioms under table 9; return the subsumptions that are not mere chains of others."""
    rules, steps, queue = RuleSet(SCHEMA_RULES), set(), list(facts.all())
    while queue:
        for rule, head in rules.consequences(facts, queue.pop()):
            if rule.name not in _CHAINS:
                steps.add(head)
            if head not in facts:
                facts.add(head)
                queue.append(head)
    return {f for f in steps - given if f[1] in (SUB, SUB_PROPERTY) and f[0] != f[2]}


def _same_as() -> Iterator[Rule]:
    """Yield the rules of equality (table 4)."""
    text = "the same resource"
    yield Rule("eq-sym", ((X, SAME_AS, Y),), (Y, SAME_AS, X), text)
    yield Rule("eq-trans", ((X, SAME_AS, Y), (Y, SAME_AS, Z)), (X, SAME_AS, Z), text, (X, Z))
    yield Rule("eq-rep-s", ((X, SAME_AS, Y), (X, P, Z)), (Y, P, Z), text, (X, Y))
    yield Rule("eq-rep-o", ((X, SAME_AS, Y), (Z, P, X)), (Z, P, Y), text, (X, Y))


class _Compiler:
    """Fills the rules of tables 4 to 8 with axioms."""

    def __init__(
        self,
        facts: Facts,
        show: Callable[[Node], str],
        direct: set[Triple],
        built_in: frozenset[tuple[Node, Node]],
        single: Callable[[str], bool],
    ) -> None:
        self._facts, self._show, self._direct = facts, show, direct
        self._built_in, self._single = built_in, single
        self._pairs: defaultdict[Node, list[tuple[Node, Node]]] = defaultdict(list)
        for subject, verb, node in sorted(facts.all(), key=str):
            self._pairs[verb].append((subject, node))

    def rules(self) -> Iterator[Rule]:
        """Yield all rules."""
        for part in (
            self._subsumptions,
            self._properties,
            self._disjoint,
            self._chains_and_keys,
            self._sets,
            self._restrictions,
            self._individuals,
        ):
            yield from part()

    def _of_class(self, name: str) -> list[Node]:
        return [s for s, c in self._pairs[TYPE_OF] if c == _owl(name)]

    def _words(self, text: str, *terms: Node) -> str:
        return text.format(*map(self._show, terms))

    def _clash(
        self, name: str, text: str, *body: Triple, apart: tuple[Var, Var] | None = None
    ) -> Rule:
        """Return the rule by which the first subject of a body contradicts an axiom."""
        head = (body[0][0], CONTRADICTION, (text, STRING))
        return Rule(name, body, head, text, apart, clash=True)

    def _one(self, name: str, text: str, *body: Triple, on: Node | None = None) -> Iterator[Rule]:
        """Yield the rules by which a and b are the same, or contradict it."""
        yield self._clash(name, text, *body, apart=(A, B))
        if not (isinstance(on, str) and self._single(on)):
            yield Rule(name, body, (A, SAME_AS, B), text, (A, B))

    def _subsumptions(self) -> Iterator[Rule]:
        for c, verb, d in sorted(self._direct, key=str):
            text = self._words("{} is a kind of {}", c, d)
            if verb == SUB_PROPERTY:
                yield Rule("prp-spo1", ((X, c, Y),), (X, d, Y), text)
            elif c != d and not _is_thing(d):
                known = (c, d) in self._built_in
                yield Rule(
                    "cax-sco", ((X, TYPE_OF, c),), (X, TYPE_OF, d), text, inferred_only=known
                )

    def _properties(self) -> Iterator[Rule]:
        for p, c in self._pairs[DOMAIN]:
            if not _is_thing(c):
                text = self._words("what has {} is a {}", p, c)
                yield Rule("prp-dom", ((X, p, Y),), (X, TYPE_OF, c), text)
        for p, c in self._pairs[RANGE]:
            if not _is_thing(c):
                text = self._words("a value of {} is a {}", p, c)
                yield Rule("prp-rng", ((X, p, Y),), (Y, TYPE_OF, c), text)
        for p in self._of_class("FunctionalProperty"):
            text = self._words("{} has at most one value", p)
            yield from self._one("prp-fp", text, (X, p, A), (X, p, B), on=p)
        for p in self._of_class("InverseFunctionalProperty"):
            text = self._words("at most one resource has a given value of {}", p)
            yield from self._one("prp-ifp", text, (A, p, X), (B, p, X))
        for p in self._of_class("IrreflexiveProperty"):
            text = self._words("{} never joins a resource to itself", p)
            yield self._clash("prp-irp", text, (X, p, X))
        for p in self._of_class("SymmetricProperty"):
            text = self._words("{} goes both ways", p)
            yield Rule("prp-symp", ((X, p, Y),), (Y, p, X), text)
        for p in self._of_class("AsymmetricProperty"):
            text = self._words("{} never goes both ways", p)
            yield self._clash("prp-asyp", text, (X, p, Y), (Y, p, X))
        for p in self._of_class("TransitiveProperty"):
            text = self._words("{} is transitive", p)
            yield Rule("prp-trp", ((X, p, Y), (Y, p, Z)), (X, p, Z), text)
        for p, q in self._pairs[_owl("inverseOf")]:
            text = self._words("{} is the inverse of {}", p, q)
            yield Rule("prp-inv1", ((X, p, Y),), (Y, q, X), text)
            yield Rule("prp-inv2", ((X, q, Y),), (Y, p, X), text)

    def _disjoint(self) -> Iterator[Rule]:
        text = "{} and {} are disjoint"
        named = partial(self._words, text)
        apart = list(self._pairs[_owl("disjointWith")])
        apart += list(self._members("AllDisjointClasses"))
        for c, d in apart:
            yield self._clash("cax-dw", named(c, d), (X, TYPE_OF, c), (X, TYPE_OF, d))
        for c, d in self._pairs[_owl("complementOf")]:
            words = self._words("{} is what is not a {}", c, d)
            yield self._clash("cls-com", words, (X, TYPE_OF, c), (X, TYPE_OF, d))
        pairs = list(self._pairs[_owl("propertyDisjointWith")])
        pairs += list(self._members("AllDisjointProperties"))
        for p, q in pairs:
            yield self._clash("prp-pdw", named(p, q), (X, p, Y), (X, q, Y))
        nothing = "nothing is of this class"
        yield self._clash("cls-nothing2", nothing, (X, TYPE_OF, _owl("Nothing")))

    def _members(self, of_class: str, *names: str) -> Iterator[tuple[Node, Node]]:
        """Yield each pair of the members of axioms of a class."""
        axioms = set(self._of_class(of_class))
        for name in names or ("members",):
            for axiom, items in _lists(self._facts, name):
                if axiom in axioms:
                    yield from ((a, b) for i, a in enumerate(items) for b in items[i + 1 :])

    def _chains_and_keys(self) -> Iterator[Rule]:
        for p, steps in _lists(self._facts, "propertyChainAxiom"):
            if not steps:
                continue
            stops = [X, *(Var(f"s{i}") for i in range(1, len(steps))), Y]
            body = tuple(zip(stops, steps, stops[1:], strict=False))
            path = " / ".join(map(self._show, steps))
            text = f"{path} leads to what {self._show(p)} leads to"
            yield Rule("prp-spo2", body, (X, p, Y), text)
        for c, keys in _lists(self._facts, "hasKey"):
            if not keys:
                continue
            body = tuple(
                atom
                for i, key in enumerate(keys)
                for atom in ((A, key, Var(f"k{i}")), (B, key, Var(f"k{i}")))
            )
            text = f"{', '.join(map(self._show, keys))} identify a {self._show(c)}"
            typed = ((A, TYPE_OF, c), (B, TYPE_OF, c))
            yield from self._one("prp-key", text, *typed, *body)

    def _sets(self) -> Iterator[Rule]:
        for c, parts in _lists(self._facts, "intersectionOf"):
            text = f"{self._show(c)} is what is a {' and a '.join(map(self._show, parts))}"
            body = tuple((X, TYPE_OF, part) for part in parts if not _is_thing(part))
            if body:
                yield Rule("cls-int1", body, (X, TYPE_OF, c), text)
            for part in parts:
                if not _is_thing(part):
                    yield Rule("cls-int2", ((X, TYPE_OF, c),), (X, TYPE_OF, part), text)
        for c, parts in _lists(self._facts, "unionOf"):
            text = f"{self._show(c)} is what is a {' or a '.join(map(self._show, parts))}"
            for part in parts:
                yield Rule("cls-uni", ((X, TYPE_OF, part),), (X, TYPE_OF, c), text)
        for c, items in _lists(self._facts, "oneOf"):
            for item in (i for i in items if not isinstance(i, tuple)):
                text = self._words("{} is one of the {}s that there are", item, c)
                yield Rule("cls-oo", (), (item, TYPE_OF, c), text)

    def _restrictions(self) -> Iterator[Rule]:
        on: defaultdict[Node, list[Node]] = defaultdict(list)
        for c, p in self._pairs[_owl("onProperty")]:
            on[c].append(p)
        of_class = dict(self._pairs[_owl("onClass")])
        for c, d in self._pairs[_owl("someValuesFrom")]:
            for p in on[c]:
                text = self._words("{} is what has a {} that is a {}", c, p, d)
                typed = () if _is_thing(d) else ((Y, TYPE_OF, d),)
                name = "cls-svf1" if typed else "cls-svf2"
                yield Rule(name, ((X, p, Y), *typed), (X, TYPE_OF, c), text)
        for c, d in self._pairs[_owl("allValuesFrom")]:
            for p in on[c]:
                text = self._words("each {1} of a {0} is a {2}", c, p, d)
                if not _is_thing(d):
                    yield Rule("cls-avf", ((X, TYPE_OF, c), (X, p, Y)), (Y, TYPE_OF, d), text)
        for c, value in self._pairs[_owl("hasValue")]:
            for p in on[c]:
                text = self._words("{} is what has the {} {}", c, p, value)
                yield Rule("cls-hv1", ((X, TYPE_OF, c),), (X, p, value), text)
                yield Rule("cls-hv2", ((X, p, value),), (X, TYPE_OF, c), text)
        for c, number in self._pairs[_owl("maxCardinality")]:
            for p in on[c]:
                yield from self._at_most(c, number, p, None)
        for c, number in self._pairs[_owl("maxQualifiedCardinality")]:
            for p in on[c]:
                yield from self._at_most(c, number, p, of_class.get(c))

    def _at_most(self, c: Node, number: Node, p: Node, d: Node | None) -> Iterator[Rule]:
        """Yield the rules of classes with at most 0 or 1 values (cls-maxc, cls-maxqc)."""
        most = number[0] if isinstance(number, tuple) else ""
        qualified = d is not None and not _is_thing(d)
        name = "cls-maxqc" if d is not None else "cls-maxc"
        what = f" that is a {self._show(d)}" if d is not None and qualified else ""
        text = f"a {self._show(c)} has at most {most} {self._show(p)}{what}"
        typed = (X, TYPE_OF, c)
        if most == "0":
            more: tuple[Triple, ...] = ((Y, TYPE_OF, d),) if d is not None and qualified else ()
            yield self._clash(name, text, typed, (X, p, Y), *more)
        elif most == "1":
            more = tuple((v, TYPE_OF, d) for v in (A, B)) if d is not None and qualified else ()
            yield from self._one(name, text, typed, (X, p, A), (X, p, B), *more, on=p)

    def _individuals(self) -> Iterator[Rule]:
        different = _owl("differentFrom")
        text = "what is different is not the same"
        yield self._clash("eq-diff1", text, (X, SAME_AS, Y), (X, different, Y))
        yield self._clash("eq-diff1", text, (X, different, X))
        for a, b in self._members("AllDifferent", "members", "distinctMembers"):
            words = self._words("{} and {} are different", a, b)
            head = (a, CONTRADICTION, (words, STRING))
            yield Rule("eq-diff2", ((a, SAME_AS, b),), head, words)
        same = "entities of a map and values are not the same as others"
        yield self._clash("eq-diff1", same, (X, SAME_AS, Y), apart=(X, Y))
        sources = dict(self._pairs[_owl("sourceIndividual")])
        verbs = dict(self._pairs[_owl("assertionProperty")])
        for name in ("targetIndividual", "targetValue"):
            for axiom, target in self._pairs[_owl(name)]:
                if axiom in sources and axiom in verbs:
                    fact = (sources[axiom], verbs[axiom], target)
                    words = self._words("it is not so that {} {} {}", *fact)
                    yield Rule("prp-npa", (fact,), (fact[0], CONTRADICTION, (words, STRING)), words)


def _is_thing(c: Node) -> bool:
    """Return whether everything is of a class, so that nobody needs to be told."""
    return c in (f"{OWL}Thing", f"{RDFS}Resource", f"{RDFS}Literal")
