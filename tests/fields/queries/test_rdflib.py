"""The same queries, by rdflib, voxel by voxel, on the same statements as triples."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

import rdflib
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from semmap.fields.queries import SelectResult, query
from semmap.language.schema import SideKind
from tests.fields.queries.arrays import KB, PREFIX, Arrays, Listed, prop, voxel_iri

SIZE = 0.5
VOXELS = [(x, y, z) for x in (-1, 0, 1) for y in (0, 1) for z in (0, 1)]
ENTITIES = ["mug", "cup", "table", "human1", "human2"]
NUMBERS = [-1.0, 0.0, 0.5, 1.0, 1.5]
DOMAINS: dict[SideKind, list[Any]] = {"voxel": VOXELS, "entity": ENTITIES, "number": NUMBERS}

PROPERTIES = (
    prop("contains"),
    prop("seenBy"),
    prop("cost", object="number"),
    prop("far", object="number"),
    prop("on", subject="entity"),
    prop("near", subject="entity"),
    prop("weight", subject="entity", object="number"),
    prop("fills", subject="entity", object="voxel"),
)


@st.composite
def catalogues(draw: st.DrawFn) -> Arrays:
    """Fields of at most ten statements each."""
    relations = []
    for each in PROPERTIES:
        pairs = st.tuples(
            st.sampled_from(DOMAINS[each.subject]), st.sampled_from(DOMAINS[each.object])
        )
        stated = draw(st.lists(pairs, max_size=10, unique=True))
        relations.append(Listed(each, [s for s, _ in stated], [o for _, o in stated]))
    return Arrays(relations, dict.fromkeys(ENTITIES, "entity"), {}, SIZE)


# Templates: ?v ?w are voxels, ?a ?b entities, ?c ?d numbers; %t and %n stand for constants.

PATTERNS = [
    "?v :contains ?a",
    "?v :contains %t",
    "?v :seenBy ?b",
    "?v :seenBy %t",
    "?v :cost ?c",
    "?v :far ?d",
    "?w :contains ?a",
    "?w :seenBy %t",
    "?w :far ?c",
    "?a :on ?b",
    "?a :on %t",
    "%t :on ?b",
    "?b :near ?a",
    "?a :weight ?d",
    "?a :fills ?v",
    "%t :fills ?w",
    "?v :far ?c",
    "?v :contains ?b ; :cost ?d",
    "?a :near ?a",
    "?v :seenBy [ :on ?b ]",
    "%t :on %t",
]
CONDITIONS = [
    "?c > %n",
    "?c <= ?d",
    "?a = ?b",
    "?a != %t",
    "?v = ?w",
    "?c * 2 - %n >= ?d",
    "BOUND(?c)",
    "!BOUND(?b)",
    "?c / ?d < %n",
    "?c > %n || ?a = %t",
    "?c < %n && ?d > %n",
    "?a IN (%t, %t)",
    "?b NOT IN (%t)",
    "COALESCE(?c, ?d, %n) > %n",
    "IF(?c > %n, ?d, %n) < %n",
    "-?c > %n",
    "?c",
    "EXISTS { ?v :seenBy ?a }",
    "NOT EXISTS { ?a :on ?b }",
    "sameTerm(?a, %t)",
    "ABS(?c) = %n",
    "NOT EXISTS { ?v :contains ?a . ?a :weight ?d }",
    "!(?c > %n)",
    "?c != ?d || BOUND(?a)",
    "EXISTS { ?w :cost ?c FILTER(?d < ?c) }",
    "EXISTS { ?b :on %t }",
    "FLOOR(?c) = CEIL(?d)",
]
ENTITY = st.sampled_from(ENTITIES).map(":{}".format)
NUMBER = st.sampled_from(NUMBERS).map(str)


def filled(templates: list[str]) -> st.SearchStrategy[str]:
    """A template with constants in its gaps."""

    def fill(template: str, entities: list[str], numbers: list[str]) -> str:
        for gap, values in (("%t", entities), ("%n", numbers)):
            for value in values:
                template = template.replace(gap, value, 1)
        return template

    return st.builds(
        fill,
        st.sampled_from(templates),
        st.lists(ENTITY, min_size=2, max_size=2),
        st.lists(NUMBER, min_size=3, max_size=3),
    )


def named(text: str) -> set[str]:
    """The variables that a text names."""
    return set(re.findall(r"[?](\w+)", text))


@st.composite
def groups(draw: st.DrawFn, deep: bool = True) -> tuple[str, set[str]]:
    """Return the text of a group, and the variables that it may bind; filters read only these."""
    text = " . ".join(draw(st.lists(filled(PATTERNS), min_size=1, max_size=3))) + " ."
    bound = named(text)
    for i in range(draw(st.integers(0, 2)) if deep else 0):
        inner, new = draw(groups(deep=False))
        match draw(st.sampled_from(["optional", "union", "minus", "values", "bind", "select"])):
            case "optional":
                text += f" OPTIONAL {{ {inner} }}"
                bound |= new
            case "minus":
                text += f" MINUS {{ {inner} }}"
            case "union":
                text = f"{{ {text} }} UNION {{ {inner} }}"
                bound |= new
            case "values":
                each = st.one_of(ENTITY, st.just("UNDEF"))
                rows = draw(st.lists(each, min_size=1, max_size=3, unique=True))
                text += f" VALUES ?a {{ {' '.join(rows)} }}"
                bound |= {"a"} if set(rows) != {"UNDEF"} else set()
            case "bind":
                if "c" in bound:
                    text += f" BIND(?c + {draw(NUMBER)} AS ?e{i})"
                    bound.add(f"e{i}")
            case "select":
                text += f" {{ SELECT DISTINCT * {{ {inner} }} }}"
                bound |= new
    for each in draw(st.lists(filled(CONDITIONS), max_size=2)):
        if named(re.sub("EXISTS {.*?(FILTER|})", "", each)) <= bound:
            text += f" FILTER({each})"
    return text, bound


def term(value: Any) -> Any:
    """A value of ours as rdflib has it, numbers as numbers."""
    if isinstance(value, tuple):
        return voxel_iri(round(each / SIZE - 0.5) for each in value)
    if isinstance(value, str):
        return rdflib.URIRef(KB + value)
    return value


def plain(value: Any) -> Any:
    """A value of rdflib's."""
    return float(value) if isinstance(value, rdflib.Literal) and value.value is not None else value


def answers(catalogue: Arrays, text: str) -> tuple[Counter[Any], Counter[Any]]:
    """Ours and rdflib's, as multisets."""
    ours = query(catalogue, PREFIX + text)
    assert isinstance(ours, SelectResult)
    # rdflib takes * for the variables of MINUS and EXISTS, too
    everything = " ".join(f"?{name}" for name in ours.names)
    head, brace, rest = text.partition("{")
    theirs = catalogue.graph().query(PREFIX + re.sub(r"\* $", everything, head) + brace + rest)
    assert theirs.vars is not None
    order = [ours.names.index(str(name)) for name in theirs.vars]
    both = (
        Counter(tuple(term(row[i]) for i in order) for row in ours),
        Counter(tuple(plain(value) for value in row) for row in theirs),  # type: ignore[union-attr]
    )
    for each in both:
        each.pop((None,) * len(order), None)  # rdflib does not show a solution that binds nothing
    return both


FORMS = [
    "SELECT * {{ {group} }}",
    "SELECT DISTINCT * {{ {group} }}",
    "SELECT {some} {{ {group} }}",
    "SELECT DISTINCT {some} {{ {group} }}",
    "SELECT {some} {{ {group} }} ORDER BY {some} LIMIT 1000",
]


@settings(max_examples=25, phases=[Phase.generate])
@given(catalogues(), groups(), st.sampled_from(FORMS), st.integers(1, 3))
def test_patterns(catalogue: Arrays, group: tuple[str, set[str]], form: str, count: int) -> None:
    text, bound = group
    some = sorted(bound)[:count]
    if some:
        ours, theirs = answers(
            catalogue, form.format(group=text, some=" ".join(f"?{name}" for name in some))
        )
        assert ours == theirs


AGGREGATES = [
    "(COUNT(*) AS ?n)",
    "(COUNT(?c) AS ?n)",
    "(COUNT(DISTINCT ?a) AS ?n)",
    "(SUM(?c) AS ?n)",
    "(AVG(?c) AS ?n)",
    "(MIN(?c) AS ?n)",
    "(MAX(?c) AS ?n)",
    "(SUM(DISTINCT ?c) AS ?n)",
    "(MIN(?c) + MAX(?c) AS ?n)",
    "(MAX(?c * 2) AS ?n)",
    "(COUNT(DISTINCT ?v) AS ?n)",
]
TAILS = ["", "", "HAVING (COUNT(*) > 1)", "HAVING (COUNT(?c) < 3)", "ORDER BY ?n"]


@settings(max_examples=20, phases=[Phase.generate])
@given(
    catalogues(),
    groups(),
    st.sampled_from(AGGREGATES),
    st.sampled_from(TAILS),
    st.lists(st.sampled_from("vabc"), max_size=2, unique=True),
)
def test_groups(
    catalogue: Arrays, group: tuple[str, set[str]], aggregate: str, tail: str, keys: list[str]
) -> None:
    # rdflib lets a group see what stands before it, which SPARQL does not: the group comes first
    text = f"{{ {group[0]} }} ?v :contains ?a ; :cost ?c . OPTIONAL {{ ?a :on ?b }}"
    by = " ".join(f"?{name}" for name in keys)
    ours, theirs = answers(
        catalogue, f"SELECT {by} {aggregate} {{ {text} }} {f'GROUP BY {by}' if by else ''} {tail}"
    )
    assert ours == theirs
