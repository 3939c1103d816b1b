"""An expression has one value: by the evaluator of fields, by SQL, and by two other engines."""

from __future__ import annotations

from datetime import datetime
from functools import cache
from typing import Any

import numpy as np
import psycopg
import pyoxigraph
import pytest
import rdflib
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from semmap.fields.queries import SelectResult
from semmap.fields.queries import query as query_fields
from semmap.fields.queries.expressions import ELEMENTWISE, OF_TEXT
from semmap.knowledge.queries import query as query_sql
from semmap.knowledge.sparql.expressions import SHARED
from semmap.language.schema import SPARQL_FUNCTIONS
from tests.effort import effort
from tests.fields.queries.arrays import Arrays

UNBOUND = "UNDEF"
DOUBLES = ("-2.5e0", "-1.5e0", "-0.5e0", "0e0", "0.49999999999999994e0", "0.5e0", "1e0", "2.5e0")
NAMES = ('"mug"', '"Mug"', '"m.g"', '"ß"', '"é"', '"É"', '"İ"', '"ΑΣ"', '"Ab\\nc"', '""', '"10"')
TRUTHS = ("true", "false")
VARIABLES = {"?x": DOUBLES, "?y": DOUBLES, "?a": NAMES, "?b": NAMES, "?p": TRUTHS, "?q": TRUTHS}
BOUND = dict(zip(VARIABLES, ("1e0", "-2.5e0", '"mug"', '"ß"', "true", "false"), strict=True))
PARTS = ('"m"', '"g"', '""', '"."', '"ß"', '"SS"', '"G"')
PATTERNS = (
    '"m.g"',
    '"^M", "i"',
    '"b.c"',
    '"b.c", "s"',
    '"^c"',
    '"^c", "m"',
    '"[^m.]g"',
    '"é", "i"',
)
WIDTH = {1: "{}", 2: "{}, {}"}


def of_kind(kind: str, deep: int) -> st.SearchStrategy[str]:
    """Expressions of a kind."""
    return {"number": numbers, "text": texts, "boolean": conditions}[kind](deep)


def of(template: str, *parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Texts of a template with parts in its gaps."""
    return st.tuples(*parts).map(lambda drawn: template.format(*drawn))


def calls(result: str, deep: int) -> list[st.SearchStrategy[str]]:
    """The functions of the table with a kind of result; second texts are constants."""
    found = []
    for function in SPARQL_FUNCTIONS.values():
        if function.result == result:
            first, *others = function.arguments
            parts = [of_kind(first, deep), *(st.sampled_from(PARTS) for _ in others)]
            found.append(of(f"{function.name}({WIDTH[len(parts)]})", *parts))
    return found


def choices(kind: str, deep: int) -> list[st.SearchStrategy[str]]:
    """IF and COALESCE."""
    part = of_kind(kind, deep)
    return [of("IF({}, {}, {})", conditions(deep), part, part), of("COALESCE({}, {})", part, part)]


@cache
def doubles(deep: int) -> st.SearchStrategy[str]:
    """Expressions of doubles, with divisions, also by 0."""
    leaf = st.sampled_from(("?x", "?y", "2.5e0", "0e0"))
    if not deep:
        return leaf
    part = doubles(deep - 1)
    each = [of(f"({{}} {operator} {{}})", part, part) for operator in "+-*/"]
    each += [of(f"({name}({{}}))", part) for name in ("ABS", "CEIL", "FLOOR", "ROUND", "-", "+")]
    return st.one_of(leaf, *each)


@cache
def numbers(deep: int) -> st.SearchStrategy[str]:
    """Expressions of numbers, without divisions."""
    leaf = st.sampled_from(("?x", "?y", "2.5e0", "3"))
    if not deep:
        return leaf
    part = numbers(deep - 1)
    each = [of(f"({{}} {operator} {{}})", part, part) for operator in "+-*"]
    each += [of("(-{})", part), of("(+{})", part)]
    return st.one_of(leaf, *each, *calls("number", deep - 1), *choices("number", deep - 1))


@cache
def texts(deep: int) -> st.SearchStrategy[str]:
    """Expressions of texts."""
    leaf = st.sampled_from(("STR(?a)", "STR(?b)"))
    if not deep:
        return leaf
    return st.one_of(leaf, *calls("text", deep - 1), *choices("text", deep - 1))


@cache
def conditions(deep: int) -> st.SearchStrategy[str]:
    """Expressions of truth values."""
    variable, name = st.sampled_from(("?a", "?b")), st.sampled_from(NAMES)
    leaf = st.one_of(
        st.sampled_from(("?p", "?q", "true", "BOUND(?x)", "BOUND(?a)", "(?a = ?b)", "(?a != ?b)")),
        of("({} = {})", variable, name),
        of("({} != {})", variable, name),
        of("({} IN ({}, {}))", variable, name, name),
        of("({} NOT IN ({}))", variable, name),
        of("sameTerm({}, {})", variable, name),
    )
    if not deep:
        return leaf
    deep -= 1
    number, text, part = numbers(deep), texts(deep), conditions(deep)
    orders = ("<", "<=", ">", ">=", "=", "!=")
    each = [of(f"({{}} {order} {{}})", kind, kind) for order in orders for kind in (number, text)]
    each += [of(f"({{}} {operator} {{}})", part, part) for operator in ("&&", "||", "=", "!=")]
    each += [of("(!{})", part), of("(!{})", number), of("({} IN ({}, {}))", number, number, number)]
    each.append(of("REGEX({}, {})", text, st.sampled_from(PATTERNS)))
    return st.one_of(leaf, *each, *calls("boolean", deep), *choices("boolean", deep))


def rows(*more: str) -> st.SearchStrategy[list[dict[str, str]]]:
    """Values of the variables; in the first row, all have one."""
    row = st.fixed_dictionaries({n: st.sampled_from((*v, *more)) for n, v in VARIABLES.items()})
    return st.lists(row, min_size=1, max_size=6).map(lambda drawn: [BOUND, *drawn])


def of_rows(expression: str, given: list[dict[str, str]]) -> str:
    """Return the query of an expression for values in a table."""
    lines = " ".join(f"({i} {' '.join(row[n] for n in VARIABLES)})" for i, row in enumerate(given))
    head = f"VALUES (?i {' '.join(VARIABLES)}) {{ {lines} }}"
    return f"SELECT ?i ?r {{ {head} BIND({expression} AS ?r) }}"


def of_constants(expression: str, given: list[dict[str, str]]) -> str:
    """Return the query of an expression with values in place of variables, a column for each."""
    columns = []
    for i, row in enumerate(given):
        text = expression
        for name, value in row.items():
            text = text.replace(f"BOUND({name})", "true") if value != UNBOUND else text
            text = text.replace(name, f"?u{name[1:]}" if value == UNBOUND else value)
        columns.append(f"({text} AS ?r{i})")
    return f"SELECT {' '.join(columns)} {{ }}"


class Names(Arrays):
    """A catalogue in which each name is an entity."""

    def find_entities(self, name: str, range_: str | None) -> frozenset[str]:
        """Return the entity."""
        return frozenset({name})


def plain(value: Any) -> Any:
    """Return a value: numbers to nine digits, without the sign of zero."""
    if isinstance(value, pyoxigraph.Literal):
        datatype = rdflib.URIRef(value.datatype.value)
        value = rdflib.Literal(value.value, datatype=datatype)
    if isinstance(value, rdflib.Literal):
        is_text = value.datatype in (None, rdflib.XSD.string)
        value = str(value) if is_text else value.value
    if value is None or isinstance(value, str | bool):
        return value
    return float(f"{float(value):.9g}") + 0.0


def by_row(found: Any) -> list[Any]:
    """Return the second column of rows in the order of the first."""
    return [plain(r) for _, r in sorted((float(plain(i)), r) for i, r in found)]


def ours(session: psycopg.Connection, expression: str, given: list[dict[str, str]]) -> list[Any]:
    """Return the values by the evaluator; SQL has the same for tables and for constants."""
    text = of_rows(expression, given)
    result = query_fields(Names([]), text)
    assert isinstance(result, SelectResult)
    found = by_row(result)
    answers = [query_sql(session, text), query_sql(session, of_constants(expression, given))]
    assert not any("evaluated by rdflib" in each for a in answers for each in a.explanation)
    assert by_row(answers[0].rows) == found
    assert [plain(value) for value in answers[1].rows[0]] == found
    return found


def test_the_table_has_both_meanings_of_each_function() -> None:
    assert SHARED.keys() == SPARQL_FUNCTIONS.keys()
    assert SPARQL_FUNCTIONS.keys() <= ELEMENTWISE.keys() | OF_TEXT.keys()


@pytest.mark.parametrize("name", SPARQL_FUNCTIONS)
def test_each_function(loft: psycopg.Connection, name: str) -> None:
    function = SPARQL_FUNCTIONS[name]
    variable, argument = {"number": ("?x", "?x"), "text": ("?a", "STR(?a)")}[function.arguments[0]]
    given = [BOUND, *(BOUND | {variable: value} for value in (*VARIABLES[variable], UNBOUND))]
    constants = PARTS if len(function.arguments) > 1 else ("",)
    for constant in constants:
        text = f"{name}({argument}{', ' * bool(constant)}{constant})"
        found = by_row(pyoxigraph.Store().query(of_rows(text, given)))
        assert ours(loft, text, given) == found, text


@settings(phases=[Phase.generate], max_examples=effort(15, 100))
@given(st.one_of(numbers(2), texts(2), conditions(2)), rows(UNBOUND))
def test_expressions(
    loft: psycopg.Connection, expression: str, given: list[dict[str, str]]
) -> None:
    found = by_row(pyoxigraph.Store().query(of_rows(expression, given)))
    assert ours(loft, expression, given) == found


@settings(phases=[Phase.generate], max_examples=effort(15, 100))
@given(doubles(3), rows())
def test_arithmetic(loft: psycopg.Connection, expression: str, given: list[dict[str, str]]) -> None:
    # oxigraph has INF for a division by 0, which is an error here and for rdflib
    found = by_row(rdflib.Graph().query(of_rows(expression, given)))
    assert ours(loft, expression, given) == found


EXTREMES = ("0e0", "-1e0", "2e-308", "-1e-300", "1e-160", "-3e-20", "7e150", "-1e200", "1.7e308")


@given(st.sampled_from("+-*/"), *[st.sampled_from(EXTREMES)] * 2)
def test_doubles_end_where_ieee_754_has_them_end(
    loft: psycopg.Connection, operator: str, x: str, y: str
) -> None:
    (found,) = query_sql(loft, f"SELECT (({x}) {operator} ({y}) AS ?r) {{ }}").rows[0]
    with np.errstate(all="ignore"):
        a, b = np.float64(x), np.float64(y)
        exact = {"+": a + b, "-": a - b, "*": a * b, "/": a / b if b else None}[operator]
    if exact is None:
        assert found is None  # a division by 0
    elif abs(exact) < 1e-300:
        assert abs(found.value) < 1e-300  # numbers without all digits are 0
    else:
        assert found.value == pytest.approx(exact, rel=1e-12)


INSTANTS = [
    f'"{text}"^^xsd:{kind}'
    for kind, texts in {
        "dateTime": (
            "2026-11-28T23:30:00-02:00",
            "2026-03-01T00:00:00Z",
            "1999-12-28T12:00:01+05:30",
            "2024-02-28T24:00:00Z",
        ),
        "date": ("2026-11-28Z", "2024-02-29Z", "2001-01-01-11:00"),
    }.items()
    for text in texts
]
DURATIONS = [
    f'"{text}"^^xsd:{kind}'
    for kind, texts in {
        "dayTimeDuration": ("P2D", "-PT36H", "PT0S", "P1DT1H1M1S", "PT90M", "P400D"),
        "yearMonthDuration": ("P1Y", "-P14M", "P0M", "P2Y3M"),
        "duration": ("P1Y2M3DT4H5M6S", "-P1M", "PT1M"),
    }.items()
    for text in texts
]
NO_TIMES = ['"P"', '"P1S"', '"PT"', '"1D"', '"P1M"', '"P1DT"', '"P1.5D"', '"2026-02-30T00:00:00Z"']
AT = st.sampled_from(INSTANTS)
SPAN = st.sampled_from(DURATIONS)
OF_TIMES = st.one_of(
    of("{} + {}", AT, SPAN),
    of("{} - {}", AT, SPAN),
    of("{} + {}", SPAN, AT),
    of("{} - {}", AT, AT),
    of("{} + {}", SPAN, SPAN),
    of("{} - {}", SPAN, SPAN),
    of("{} = {}", SPAN, SPAN),
    of("{} < {} - {}", AT, AT, SPAN),
    *(of(f"{{}} - {{}} < {span}", AT, AT) for span in DURATIONS[:6]),
    *(of(f"{name}({{}})", AT) for name in ("YEAR", "MONTH", "DAY", "HOURS", "MINUTES", "SECONDS")),
)
WITH_TYPES = "PREFIX xsd: <http://www.w3.org/2001/XMLSchema#> "


def of_time(term: Any) -> Any:
    """Return a term by what it means: the instant of a time, all else as it is written."""
    if term is None:
        return None
    datatype = getattr(term, "datatype", None)
    kind = str(getattr(datatype, "value", datatype)).rpartition("#")[2]
    written = (
        str(getattr(term, "value", term)) if isinstance(term, pyoxigraph.Literal) else str(term)
    )
    if kind == "dateTime":
        return datetime.fromisoformat(written.replace("Z", "+00:00"))
    return float(written) if kind in ("integer", "decimal") else (kind, written)


@given(OF_TIMES)
def test_times_and_durations(loft: psycopg.Connection, expression: str) -> None:
    text = f"{WITH_TYPES}SELECT ({expression} AS ?r) {{ }}"
    (expected,) = next(iter(pyoxigraph.Store().query(text)))
    answer = query_sql(loft, text)
    assert not any("evaluated by rdflib" in each for each in answer.explanation)
    if expected is not None:  # oxigraph has no value where a month has fewer days
        assert of_time(answer.rows[0][0]) == of_time(expected), expression


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (
            '"2000-10-30T11:12:00"^^xsd:dateTime + "P1Y2M"^^xsd:yearMonthDuration',
            "2001-12-30T11:12:00+00:00",
        ),
        (
            '"2024-01-31T08:00:00Z"^^xsd:dateTime + "P1M"^^xsd:yearMonthDuration',
            "2024-02-29T08:00:00+00:00",
        ),
        ('"2024-03-31Z"^^xsd:date - "P1M"^^xsd:yearMonthDuration', "2024-02-29Z"),
        ('"PT2H10M"^^xsd:dayTimeDuration * 2.1', "PT4H33M"),
        ('"P2Y11M"^^xsd:yearMonthDuration * 2.3', "P6Y9M"),
        ('"P2Y11M"^^xsd:yearMonthDuration / 1.5', "P1Y11M"),
        ('"P3Y4M"^^xsd:yearMonthDuration / "-P1Y4M"^^xsd:yearMonthDuration', "-2.5"),
        ('"P1D"^^xsd:dayTimeDuration / 0', None),
        ('"P1M"^^xsd:yearMonthDuration < "P40D"^^xsd:dayTimeDuration', None),
        ('"9998-06-01T00:00:00Z"^^xsd:dateTime + "P2Y"^^xsd:duration', None),
        *(
            (f'{each}^^xsd:dayTimeDuration + "PT1S"^^xsd:dayTimeDuration', None)
            for each in NO_TIMES
        ),
        *((f'{each}^^xsd:dateTime + "PT1S"^^xsd:dayTimeDuration', None) for each in NO_TIMES),
    ],
)
def test_durations_as_xpath_has_them(
    loft: psycopg.Connection, expression: str, expected: str | None
) -> None:
    """Among them, examples of XQuery and XPath Functions 3.1, sections 8.4 and 9.7."""
    (found,) = query_sql(loft, f"{WITH_TYPES}SELECT ({expression} AS ?r) {{ }}").rows[0]
    assert (None if found is None else str(found)) == expected


WRITTEN = ("a.b", "[.]", "^.$", r"\\.", "(", "[", "x{2", "(.", "b.c", "[^.]c", "")


@given(st.sampled_from(WRITTEN), st.sampled_from(("", "i", "s", "m", "z")), st.sampled_from(NAMES))
def test_patterns_that_are_computed(
    loft: psycopg.Connection, pattern: str, flags: str, name: str
) -> None:
    """A wrong pattern or flag is an error of its row alone."""
    given = f'VALUES (?n ?p ?f) {{ ({name} "{pattern}" "{flags}") ("mug" "m.g" "") }}'
    text = f"SELECT ?p (REGEX(?n, ?p, ?f) AS ?r) {{ {given} }}"
    expected = {str(p.value): plain(r) for p, r in pyoxigraph.Store().query(text)}
    assert {str(p): plain(r) for p, r in query_sql(loft, text).rows} == expected


@pytest.mark.parametrize("start", ["-1e300", "0", "2", "1e300"])
def test_parts_of_texts_from_anywhere(loft: psycopg.Connection, start: str) -> None:
    (found,) = query_sql(loft, f'SELECT (SUBSTR("mug", {start}) AS ?r) {{ }}').rows[0]
    assert str(found) == "mug"[max(0, int(float(start)) - 1) :]


@pytest.mark.parametrize("text", ["CONCAT()", "1 IN ()"])
def test_lists_of_no_expressions(loft: psycopg.Connection, text: str) -> None:
    text = f"SELECT ({text} AS ?r) {{ }}"
    assert plain(query_sql(loft, text).rows[0][0]) == plain(
        next(iter(pyoxigraph.Store().query(text)))[0]
    )


AGGREGATES = ("COUNT", "SUM", "AVG", "MIN", "MAX")


@settings(phases=[Phase.generate], max_examples=effort(15, 100))
@given(
    st.sampled_from(AGGREGATES), st.booleans(), numbers(1), rows(UNBOUND), st.sampled_from("abpxy")
)
def test_aggregates(
    loft: psycopg.Connection,
    function: str,
    distinct: bool,
    expression: str,
    given: list[dict[str, str]],
    key: str,
) -> None:
    body = of_rows(expression, given).partition("{")[2]
    value = f"({function}({'DISTINCT ' * distinct}?r) AS ?n)"
    text = f"SELECT ?{key} {value} {{ {body} GROUP BY ?{key}"
    result = query_fields(Names([]), text)
    assert isinstance(result, SelectResult)
    answers: list[Any] = [result, query_sql(loft, text).rows]
    if UNBOUND not in text:  # an error in a group is one of all its aggregates for oxigraph
        answers.append(pyoxigraph.Store().query(text))
    found = [sorted(map(str, ([plain(v) for v in row] for row in rows))) for rows in answers]
    assert all(each == found[0] for each in found)


@pytest.mark.parametrize("constant", ["false", "0", '""', "true", "1", "1 = 2", "!true"])
def test_filters_of_constants(loft: psycopg.Connection, constant: str) -> None:
    for pattern in ("FILTER({})", "OPTIONAL {{ VALUES ?y {{ 1 }} FILTER({}) }}"):
        text = f"SELECT * {{ VALUES ?x {{ 1 2 }} {pattern.format(constant)} }}"
        result = query_fields(Names([]), text)
        assert isinstance(result, SelectResult)
        expected = list(pyoxigraph.Store().query(text))
        assert len(result) == len(query_sql(loft, text).rows) == len(expected)
