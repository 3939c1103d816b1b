"""rdflib's grammar of SPARQL, loaded once more, with STORE, AT and DURING, and with positions."""

from __future__ import annotations

import importlib.util
import threading
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from types import ModuleType
from typing import Any, Literal

import pyparsing
import rdflib
from rdflib.plugins.sparql.parserutils import Comp, CompValue, Param, ParamList

from semmap.language.error import QueryError
from semmap.language.normalise import NormalisedText, skip_space
from semmap.language.terms import with_position

Form = Literal["query", "update"]

_LOCK = threading.Lock()  # pyparsing's elements are not thread-safe


def read_syntax(text: NormalisedText, form: Form, *, whole: bool = False) -> Any:
    """Return rdflib's syntax tree; the `whole` of SPARQL has lists, and no clauses of our own."""
    with _LOCK:
        try:
            return _kept_grammar(form, whole).parse_string(text.sparql, parse_all=True)
        except pyparsing.ParseBaseException as error:
            grammar, failures = _recording_grammar(form, whole)
            failures.clear()
            with suppress(pyparsing.ParseBaseException):
                grammar.parse_string(text.sparql, parse_all=True)
            raise _syntax_error(text, failures, error.loc) from None


def _syntax_error(
    text: NormalisedText, failures: list[tuple[int, str]], position: int
) -> QueryError:
    furthest = max([position, *(failed for failed, _ in failures)])
    expected = sorted({word for failed, word in failures if failed == furthest and word})
    at_end = furthest >= len(text.sparql.rstrip())
    reason = "the text ends too early" if at_end else "not SPARQL"
    if 0 < len(expected) <= 8:
        reason += f": expected {' or '.join(expected)}"
    return text.error(reason, furthest)


@cache
def _recording_grammar(form: Form, whole: bool) -> tuple[Any, list[tuple[int, str]]]:
    """Return a slow grammar for a second reading, and its failures: position, expected word."""
    grammar = _own_grammar(form, whole)
    failures: list[tuple[int, str]] = []

    def record(_: str, position: int, element: Any, __: Exception) -> None:
        word = element.match if isinstance(element, pyparsing.Literal) else ""
        failures.append((position, word))

    for element in _elements(grammar):
        if isinstance(element, pyparsing.Token):
            element.set_fail_action(record)
    return grammar, failures


def _own_grammar(form: Form, whole: bool) -> Any:
    parser = _loaded_parser()
    for name in ("INTEGER", "DECIMAL", "DOUBLE"):  # rdflib cannot negate a decimal
        getattr(parser, f"{name}_NEGATIVE").set_parse_action(_negative)
    for element in _elements(parser.PathOneInPropertySet):
        if isinstance(element, Comp) and element.name == "InversePath":  # without its property
            element.set_name("PathEltOrInverse")
            element.expr = "^" + Param("part", parser.iri | parser.A)
    if form == "update":
        grammar = parser.UpdateUnit
    else:
        grammar = parser.QueryUnit if whole else _extended_query(parser)
    for original in () if whole else (parser.Collection, parser.CollectionPath):
        original.set_parse_action(_collection)
    for element in _elements(grammar):
        if element.parseAction or isinstance(element, Comp):
            element.add_parse_action(_set_position)
    grammar.ignore("#" + pyparsing.rest_of_line)
    return grammar


_kept_grammar = cache(_own_grammar)


def _loaded_parser() -> ModuleType:
    """Return rdflib's module, loaded once more: to copy its objects takes longer."""
    spec = importlib.util.find_spec("rdflib.plugins.sparql.parser")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _extended_query(parser: ModuleType) -> Any:
    """Return the grammar of queries, with the clauses after WHERE and after each modifier."""
    rest = parser.WhereClause + _clauses(parser) + parser.SolutionModifier + _clauses(parser)
    rest = rest + parser.ValuesClause + _clauses(parser)
    dataset = pyparsing.ZeroOrMore(ParamList("datasetClause", parser.DatasetClause))
    select = Comp("SelectQuery", parser.SelectClause + dataset + rest)
    ask = Comp("AskQuery", pyparsing.CaselessKeyword("ASK") + dataset + rest)
    return parser.Prologue + (select | parser.ConstructQuery | parser.DescribeQuery | ask)


def _clauses(parser: ModuleType) -> Any:
    store = Comp("Store", pyparsing.CaselessKeyword("STORE") + Param("iri", parser.iri))
    moment = Comp("At", pyparsing.CaselessKeyword("AT") + Param("moment", parser.RDFLiteral))
    span = Comp(
        "During",
        pyparsing.CaselessKeyword("DURING")
        + ParamList("bound", parser.RDFLiteral)
        + pyparsing.Optional(ParamList("bound", parser.RDFLiteral)),
    )
    return pyparsing.ZeroOrMore(ParamList("clause", store | moment | span))


def _elements(root: Any) -> Iterator[Any]:
    seen, stack = set(), [root]
    while stack:
        element = stack.pop()
        if element is None or id(element) in seen:
            continue
        seen.add(id(element))
        yield element
        stack += [*getattr(element, "exprs", ()), getattr(element, "expr", None)]


def _set_position(text: str, position: int, tokens: Any) -> Any:
    return with_position(tokens[0], skip_space(text, position)) if len(tokens) == 1 else None


def _negative(tokens: Any) -> rdflib.Literal:
    return rdflib.Literal(f"-{tokens[0]}", datatype=tokens[0].datatype)


def _collection(_: str, position: int, __: Any) -> CompValue:
    found = CompValue("Collection")
    found.position = position
    return found
