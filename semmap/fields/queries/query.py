"""Queries on a catalogue of fields."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import rdflib

from semmap.fields.queries.columns import Catalogue, UnknownError
from semmap.fields.queries.evaluate import evaluate
from semmap.fields.queries.expressions import Context
from semmap.fields.queries.query_result import SelectResult, StoreResult
from semmap.fields.queries.store_clause import StoreChecker
from semmap.fields.queries.table import LimitError, unbound
from semmap.language.checker import Checker
from semmap.language.error import TOO_DEEP
from semmap.language.parser import ParsedText, parse_query
from semmap.language.terms import EVERYTHING


def query(
    catalogue: Catalogue, text: str, now: datetime | None = None
) -> SelectResult | StoreResult | bool:
    """Answer a query: a SelectResult, a StoreResult with STORE, or a bool for ASK.

    Parameters
    ----------
    text : SPARQL with the clauses of `docs/fields_language.md`, or in the notation of reMap
    now : from which DURING counts back, aware; the present if not given

    Raises
    ------
    QueryError
        With the place in the text: it is not SPARQL, names or combines what does not fit, exceeds a
        limit, or reads what nothing states (no source provides it, or an entity has no voxels).
    """
    parsed = parse_query(text)
    try:
        past = _at_time(parsed, catalogue, now)
        return _select(parsed, past) if parsed.store is None else _store(parsed, past)
    except (LimitError, UnknownError) as error:
        raise parsed.error(str(error), 0) from None
    except RecursionError:
        raise parsed.error(TOO_DEEP, 0) from None


def _select(parsed: ParsedText, catalogue: Catalogue) -> SelectResult | bool:
    checker = Checker(parsed, catalogue)
    pattern = checker.check(parsed.algebra)
    context = Context(catalogue)
    table = evaluate(pattern, context)
    if parsed.form == "AskQuery":
        return table.rows > 0
    names = [str(name) for name in parsed.names]
    if names == [EVERYTHING]:
        names = checker.visible_names(pattern)
    columns = tuple(
        table.columns.get(name) or unbound(checker.kinds[name][0], table.rows) for name in names
    )
    strings = tuple(context.names.names)
    return SelectResult(tuple(names), columns, table.rows, strings, catalogue.voxel_size)


def _store(parsed: ParsedText, catalogue: Catalogue) -> StoreResult:
    checker = StoreChecker(parsed, catalogue)
    pattern = checker.check_query()
    context = Context(catalogue)
    return checker.result(evaluate(pattern, context), context)


def _at_time(parsed: ParsedText, catalogue: Catalogue, now: datetime | None) -> Catalogue:
    """Return the catalogue as it was at the time of AT or DURING."""
    try:
        if parsed.moment is not None:
            moment = _moment(parsed, parsed.moment)
            return catalogue.during(moment, moment)
        if len(parsed.span) == 2:
            begin, end = (_moment(parsed, each) for each in parsed.span)
            if end < begin:
                raise parsed.error("the end is before the beginning: exchange them", parsed.span[1])
            return catalogue.during(begin, end)
        if parsed.span:
            end = datetime.now(UTC) if now is None else now
            return catalogue.during(end - _duration(parsed, parsed.span[0]), end)
    except LookupError as error:
        at = parsed.moment if parsed.moment is not None else parsed.span[0]
        raise parsed.error(str(error.args[0] if error.args else error), at) from error
    return catalogue


def _moment(parsed: ParsedText, literal: Any) -> datetime:
    value = literal.value
    if literal.datatype != rdflib.XSD.dateTime or not isinstance(value, datetime):
        raise parsed.error(
            'this is not a time: write "2026-01-31T12:00:00Z"^^xsd:dateTime', literal
        )
    if value.tzinfo is None:
        raise parsed.error(f'this time has no zone: for UTC write "{literal}Z"', literal)
    return value


def _duration(parsed: ParsedText, literal: Any) -> timedelta:
    value = literal.value
    types = (rdflib.XSD.duration, rdflib.XSD.dayTimeDuration)
    if literal.datatype not in types or not isinstance(value, timedelta):
        raise parsed.error(
            'this is not a duration: write "PT10S"^^xsd:duration, or two times of xsd:dateTime',
            literal,
        )
    if value < timedelta(0):
        raise parsed.error("a duration must be at least 0: it counts back from now", literal)
    return value
