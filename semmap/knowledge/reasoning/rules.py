"""The rules of OWL 2 RL (Profiles, section 4.3, tables 4 to 9), filled with the axioms of a map."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from semmap.knowledge.reasoning.engine import (
    SAME_AS,
    TYPE_OF,
    Facts,
    Node,
    Rule,
    RuleSet,
    Triple,
    Var,
    filled,
    solutions,
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

_RDFS = ("subClassOf", "subPropertyOf", "domain", "range")
X, Y, Z, V, W = map(Var, "xyzvw")


def _term(word: str) -> Node:
    if len(word) == 1:
        return TYPE_OF if word == "a" else Var(word)
    return f"{RDFS if word in _RDFS else OWL}{word}"


def _atoms(text: str) -> tuple[Triple, ...]:
    """Return triples of a text, as in Turtle: letters are variables, names those of RDFS or OWL."""
    return tuple((s, v, o) for s, v, o in (map(_term, t.split()) for t in text.split(" . ")))


_NARROWER = "x onProperty p . y onProperty p . x {0} c . y {0} d . c subClassOf d"
_ALIKE = "x onProperty p . y onProperty p . x {0} c . y {0} c"
_SUB_PROPERTY = "x onProperty p . y onProperty q . p subPropertyOf q . x {0} c . y {0} c"
_TABLE_9 = (
    ("scm-sco", "x subClassOf y . y subClassOf z", "x subClassOf z"),
    ("scm-eqc1", "x equivalentClass y", "x subClassOf y"),
    ("scm-eqc1", "x equivalentClass y", "y subClassOf x"),
    ("scm-eqc2", "x subClassOf y . y subClassOf x", "x equivalentClass y"),
    ("scm-spo", "x subPropertyOf y . y subPropertyOf z", "x subPropertyOf z"),
    ("scm-eqp1", "x equivalentProperty y", "x subPropertyOf y"),
    ("scm-eqp1", "x equivalentProperty y", "y subPropertyOf x"),
    ("scm-eqp2", "x subPropertyOf y . y subPropertyOf x", "x equivalentProperty y"),
    ("scm-dom1", "p domain x . x subClassOf y", "p domain y"),
    ("scm-dom2", "q domain x . p subPropertyOf q", "p domain x"),
    ("scm-rng1", "p range x . x subClassOf y", "p range y"),
    ("scm-rng2", "q range x . p subPropertyOf q", "p range x"),
    ("scm-svf1", _NARROWER.format("someValuesFrom"), "x subClassOf y"),
    ("scm-avf1", _NARROWER.format("allValuesFrom"), "x subClassOf y"),
    ("scm-cls", _ALIKE.format("someValuesFrom"), "x subClassOf y"),
    ("scm-cls", _ALIKE.format("allValuesFrom"), "x subClassOf y"),
    ("scm-cls", _ALIKE.format("hasValue"), "x subClassOf y"),
    ("scm-svf2", _SUB_PROPERTY.format("someValuesFrom"), "x subClassOf y"),
    ("scm-avf2", _SUB_PROPERTY.format("allValuesFrom"), "y subClassOf x"),
    ("scm-hv", _SUB_PROPERTY.format("hasValue"), "x subClassOf y"),
)
"""Rules about axioms. What table 9 has of each class and property itself is left out."""

_CHAINS = ("scm-sco", "scm-spo")
SCHEMA_RULES = tuple(Rule(name, _atoms(body), _atoms(head)[0], "") for name, body, head in _TABLE_9)

_EQUALITY = (
    ("eq-sym", "x sameAs y", "y sameAs x", None),
    ("eq-trans", "x sameAs y . y sameAs z", "x sameAs z", (X, Z)),
    ("eq-rep-s", "x sameAs y . x p z", "y p z", (X, Y)),
    ("eq-rep-o", "x sameAs y . z p x", "z p y", (X, Y)),
)
"""Table 4, and which resources must not be one already."""

_CLASH, _ONE = "contradiction", "v and w are one"
_TABLES_5_TO_8 = (
    ("prp-dom", "what has {p} is a {c}", "p domain c", "x p y", "x a c"),
    ("prp-rng", "a value of {p} is a {c}", "p range c", "x p y", "y a c"),
    ("prp-fp", "{p} has at most one value", "p a FunctionalProperty", "x p v . x p w", _ONE),
    (
        "prp-ifp",
        "at most one resource has a given value of {p}",
        "p a InverseFunctionalProperty",
        "v p x . w p x",
        _ONE,
    ),
    ("prp-irp", "{p} never joins a resource to itself", "p a IrreflexiveProperty", "x p x", _CLASH),
    ("prp-symp", "{p} goes both ways", "p a SymmetricProperty", "x p y", "y p x"),
    ("prp-asyp", "{p} never goes both ways", "p a AsymmetricProperty", "x p y . y p x", _CLASH),
    ("prp-trp", "{p} is transitive", "p a TransitiveProperty", "x p y . y p z", "x p z"),
    ("prp-inv1", "{p} is the inverse of {q}", "p inverseOf q", "x p y", "y q x"),
    ("prp-inv2", "{p} is the inverse of {q}", "p inverseOf q", "x q y", "y p x"),
    ("cls-com", "{c} is what is not a {d}", "c complementOf d", "x a c . x a d", _CLASH),
    (
        "cls-svf1",
        "{c} is what has a {p} that is a {d}",
        "c someValuesFrom d . c onProperty p",
        "x p y . y a d",
        "x a c",
    ),
    (
        "cls-avf",
        "each {p} of a {c} is a {d}",
        "c allValuesFrom d . c onProperty p",
        "x a c . x p y",
        "y a d",
    ),
    ("cls-hv1", "{c} is what has the {p} {o}", "c hasValue o . c onProperty p", "x a c", "x p o"),
    ("cls-hv2", "{c} is what has the {p} {o}", "c hasValue o . c onProperty p", "x p o", "x a c"),
)
"""Rules about individuals: name, the axiom in words and as triples, body, head."""


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
    known: frozenset[Triple] = frozenset(),
    same: bool,
) -> Compiled:
    """Return the rules of axioms; `show` names their terms in texts.

    Types are told with the `built_in` pairs of a class and a superclass already. All values of a
    `single` property are entities or literals, so that two are never one resource. What is `known`
    to follow from the axioms is not stated. `same`: with the rules of equality.
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
    if same:
        rules += (
            Rule(name, _atoms(body), _atoms(head)[0], "the same resource", apart)
            for name, body, head, apart in _EQUALITY
        )
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
        if f not in given | known and f[0] != f[2] and (f[0], f[2]) not in built_in
    )
    return Compiled(RuleSet(rules), classes, heads, None if everything else properties)


def _lists(facts: Facts, name: str) -> Iterator[tuple[Node, list[Node]]]:
    """Yield the subjects of a property of lists, with the members."""
    for subject, _, node in sorted(facts.match(None, _term(name), None), key=str):
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

    def rules(self) -> Iterator[Rule]:
        """Yield all rules."""
        for part in (
            self._subsumptions,
            self._filled,
            self._disjoint,
            self._chains_and_keys,
            self._sets,
            self._restrictions,
            self._individuals,
        ):
            yield from part()

    def _pairs(self, name: str) -> list[tuple[Node, Node]]:
        return sorted(((s, o) for s, _, o in self._facts.match(None, _term(name), None)), key=str)

    def _words(self, text: str, *terms: Node) -> str:
        return text.format(*map(self._show, terms))

    def _clash(
        self, name: str, text: str, *body: Triple, apart: tuple[Var, Var] | None = None
    ) -> Rule:
        """Return the rule by which the first subject of a body contradicts an axiom."""
        head = (body[0][0], CONTRADICTION, (text, STRING))
        return Rule(name, body, head, text, apart, clash=True)

    def _one(self, name: str, text: str, *body: Triple, on: Node | None = None) -> Iterator[Rule]:
        """Yield the rules by which v and w are the same, or contradict it."""
        yield self._clash(name, text, *body, apart=(V, W))
        if not (isinstance(on, str) and self._single(on)):
            yield Rule(name, body, (V, SAME_AS, W), text, (V, W))

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

    def _filled(self) -> Iterator[Rule]:
        for name, words, axioms, atoms, head in _TABLES_5_TO_8:
            for found in sorted(solutions(self._facts, _atoms(axioms), {}), key=str):
                text = words.format(**{each: self._show(node) for each, node in found.items()})
                body = [filled(atom, found) for atom in _atoms(atoms)]
                body = [each for each in body if each[0] != Y or not _is_typed_thing(each)]
                if head == _CLASH:
                    yield self._clash(name, text, *body)
                elif head == _ONE:
                    on = found["p"] if body[-1][2] == W else None
                    yield from self._one(name, text, *body, on=on)
                elif not _is_typed_thing(made := filled(_atoms(head)[0], found)):
                    yield Rule(name, tuple(body), made, text)

    def _disjoint(self) -> Iterator[Rule]:
        apart = "{} and {} are disjoint"
        for c, d in (*self._pairs("disjointWith"), *self._members("AllDisjointClasses")):
            yield self._clash("cax-dw", self._words(apart, c, d), (X, TYPE_OF, c), (X, TYPE_OF, d))
        pairs = (*self._pairs("propertyDisjointWith"), *self._members("AllDisjointProperties"))
        for p, q in pairs:
            yield self._clash("prp-pdw", self._words(apart, p, q), (X, p, Y), (X, q, Y))
        nothing = "nothing is of this class"
        yield self._clash("cls-nothing2", nothing, (X, TYPE_OF, _term("Nothing")))

    def _members(self, of_class: str, *names: str) -> Iterator[tuple[Node, Node]]:
        """Yield each pair of the members of axioms of a class."""
        axioms = {axiom for axiom, _, _ in self._facts.match(None, TYPE_OF, _term(of_class))}
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
                for atom in ((V, key, Var(f"k{i}")), (W, key, Var(f"k{i}")))
            )
            text = f"{', '.join(map(self._show, keys))} identify a {self._show(c)}"
            typed = ((V, TYPE_OF, c), (W, TYPE_OF, c))
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
        of_class = dict(self._pairs("onClass"))
        for name in ("maxCardinality", "maxQualifiedCardinality"):
            axioms = _atoms(f"c {name} n . c onProperty p")
            for found in sorted(solutions(self._facts, axioms, {}), key=str):
                c = found["c"]
                d = None if name == "maxCardinality" else of_class.get(c)
                yield from self._at_most(c, found["n"], found["p"], d)

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
            more = tuple((v, TYPE_OF, d) for v in (V, W)) if d is not None and qualified else ()
            yield from self._one(name, text, typed, (X, p, V), (X, p, W), *more, on=p)

    def _individuals(self) -> Iterator[Rule]:
        different = _term("differentFrom")
        text = "what is different is not the same"
        yield self._clash("eq-diff1", text, (X, SAME_AS, Y), (X, different, Y))
        yield self._clash("eq-diff1", text, (X, different, X))
        for a, b in self._members("AllDifferent", "members", "distinctMembers"):
            words = self._words("{} and {} are different", a, b)
            head = (a, CONTRADICTION, (words, STRING))
            yield Rule("eq-diff2", ((a, SAME_AS, b),), head, words)
        same = "entities of a map and values are not the same as others"
        yield self._clash("eq-diff1", same, (X, SAME_AS, Y), apart=(X, Y))
        sources = dict(self._pairs("sourceIndividual"))
        verbs = dict(self._pairs("assertionProperty"))
        for name in ("targetIndividual", "targetValue"):
            for axiom, target in self._pairs(name):
                if axiom in sources and axiom in verbs:
                    fact = (sources[axiom], verbs[axiom], target)
                    words = self._words("it is not so that {} {} {}", *fact)
                    yield Rule("prp-npa", (fact,), (fact[0], CONTRADICTION, (words, STRING)), words)


def _is_typed_thing(fact: Triple) -> bool:
    return fact[1] == TYPE_OF and _is_thing(fact[2])


def _is_thing(c: Node) -> bool:
    """Return whether everything is of a class, so that nobody needs to be told."""
    return c in (f"{OWL}Thing", f"{RDFS}Resource", f"{RDFS}Literal")
