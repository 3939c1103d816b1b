"""The grammar: that of rdflib, with STORE, AT and DURING.

rdflib's grammar is copied before it is extended, and its terms come out with their places in the
text, which errors name.
"""

from __future__ import annotations

import copy
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import pyparsing
import rdflib
from rdflib.plugins.sparql import algebra, parser
from rdflib.plugins.sparql.parserutils import Comp, CompValue, Param, ParamList

from semmap.language.error import QueryError
from semmap.language.normalise import Normalised, normalise

__all__ = [
    "EVERYTHING",
    "TOO_DEEP",
    "BlankNode",
    "Iri",
    "Literal",
    "Name",
    "Parsed",
    "parse_query",
    "parse_update",
    "place",
]


class Iri(rdflib.URIRef):
    """An IRI and its place."""

    at: int


class Literal(rdflib.Literal):
    """A literal and its place."""

    at: int


class Name(rdflib.Variable):
    """A variable and its place."""

    at: int


class BlankNode(rdflib.BNode):
    """A blank node and its place."""

    at: int


TOO_DEEP = "this is nested too deeply, or has too many parts: use fewer brackets and UNIONs"

EVERYTHING = "*"
"""In place of a variable: all that can be seen."""

_PLACED: tuple[tuple[type, type[Any]], ...] = (
    (rdflib.URIRef, Iri),
    (rdflib.Literal, Literal),
    (rdflib.Variable, Name),
    (rdflib.BNode, BlankNode),
)


def place(term: Any) -> int | None:
    """Where a term or a part of the tree stands; None for what the translation made."""
    at = getattr(term, "at", None)
    return at if isinstance(at, int) else None


@dataclass(frozen=True)
class Parsed:
    """A text as SPARQL's algebra.

    Attributes
    ----------
    form : "SelectQuery", "AskQuery" or "Update"
    algebra : of a query
    names : what a query projects, in order; EVERYTHING for all
    store, moment, span : the IRI of STORE, the literal of AT, the one or two of DURING
    requests : of an update
    """

    source: Normalised
    form: str
    algebra: Any = None
    names: tuple[rdflib.Variable, ...] = ()
    store: Iri | None = None
    moment: Literal | None = None
    span: tuple[Literal, ...] = ()
    requests: tuple[Any, ...] = ()

    def error(self, reason: str, at: object) -> QueryError:
        """An error at a term, a part of the tree, or a place."""
        return _error(self.source, reason, at)


def _error(source: Normalised, reason: str, at: object) -> QueryError:
    where = at if isinstance(at, int) else place(at)
    return QueryError(reason, source.source, source.offset(_skip(source.text, where or 0)))


def _skip(text: str, position: int) -> int:
    """The first place from there on that is no space or comment."""
    while position < len(text) and (text[position].isspace() or text[position] == "#"):
        position = (
            text.find("\n", position) + 1 or len(text) if text[position] == "#" else (position + 1)
        )
    return position


def _clauses() -> Any:
    store = Comp("Store", pyparsing.CaselessKeyword("STORE") + Param("iri", parser.iri))
    moment = Comp("At", pyparsing.CaselessKeyword("AT") + Param("moment", parser.RDFLiteral))
    span = Comp(
        "During",
        pyparsing.CaselessKeyword("DURING")
        + ParamList("bound", parser.RDFLiteral)
        + pyparsing.Optional(ParamList("bound", parser.RDFLiteral)),
    )
    return pyparsing.ZeroOrMore(ParamList("clause", store | moment | span))


def _extended() -> Any:
    """The query with the clauses between WHERE and the other modifiers, and after these."""
    rest = parser.WhereClause + _clauses() + parser.SolutionModifier + _clauses()
    rest = rest + parser.ValuesClause + _clauses()
    dataset = pyparsing.ZeroOrMore(ParamList("datasetClause", parser.DatasetClause))
    select = Comp("SelectQuery", parser.SelectClause + dataset + rest)
    ask = Comp("AskQuery", pyparsing.CaselessKeyword("ASK") + dataset + rest)
    return parser.Prologue + (select | parser.ConstructQuery | parser.DescribeQuery | ask)


def _elements(root: Any) -> Iterator[Any]:
    seen, stack = set(), [root]
    while stack:
        element = stack.pop()
        if element is None or id(element) in seen:
            continue
        seen.add(id(element))
        yield element
        stack += [*getattr(element, "exprs", ()), getattr(element, "expr", None)]


def _place(text: str, at: int, tokens: Any) -> Any:
    """Give what was just read its place."""
    if len(tokens) != 1:
        return None
    (token,) = tokens
    at = _skip(text, at)
    if isinstance(token, CompValue):
        token.at = at
        return None
    for kind, placed in _PLACED:
        if isinstance(token, kind):
            term = placed(token)
            term.at = at
            return term
    return None


def _collection(_: str, at: int, __: Any) -> CompValue:
    found = CompValue("Collection")
    found.at = at
    return found


def _copied() -> tuple[Any, Any]:
    """Copies of the grammars of queries and updates, so that rdflib's own stay as they are."""
    originals = (_extended(), parser.UpdateUnit)
    # What tells that there is no default is compared by identity.
    memo = {
        id(element.defaultValue): element.defaultValue
        for original in originals
        for element in _elements(original)
        if isinstance(element, pyparsing.Opt)
    }
    grammars = copy.deepcopy(originals, memo)
    for original in (parser.Collection, parser.CollectionPath):
        memo[id(original)].set_parse_action(_collection)
    comment = "#" + pyparsing.rest_of_line
    seen = set()
    for grammar in grammars:
        for element in _elements(grammar):
            if id(element) not in seen and (element.parseAction or isinstance(element, Comp)):
                element.add_parse_action(_place)
            seen.add(id(element))
        grammar.ignore(comment)
    return grammars


@cache
def _grammars() -> tuple[Any, Any]:
    return _copied()


@cache
def _watched() -> tuple[tuple[Any, Any], list[tuple[int, str]]]:
    """Grammars that write down what they looked for in vain, and where: a slow second reading."""
    grammars = _copied()
    missed: list[tuple[int, str]] = []

    def note(_: str, at: int, element: Any, __: Exception) -> None:
        missed.append((at, element.match if isinstance(element, pyparsing.Literal) else ""))

    for grammar in grammars:
        for element in _elements(grammar):
            if isinstance(element, pyparsing.Token):
                element.set_fail_action(note)
    return grammars, missed


_LOCK = threading.Lock()
"""pyparsing's elements are not for several threads at once."""


def _read(source: Normalised, which: int) -> Any:
    with _LOCK:
        try:
            return _grammars()[which].parse_string(source.text, parse_all=True)
        except pyparsing.ParseBaseException as error:
            grammars, missed = _watched()
            missed.clear()
            with suppress(pyparsing.ParseBaseException):
                grammars[which].parse_string(source.text, parse_all=True)
            raise _syntax_error(source, missed, error.loc) from None


def _syntax_error(source: Normalised, missed: list[tuple[int, str]], at: int) -> QueryError:
    furthest = max([at, *(place for place, _ in missed)])
    wanted = sorted({word for place, word in missed if place == furthest and word})
    reason = "the text ends too early" if furthest >= len(source.text.rstrip()) else "not SPARQL"
    if 0 < len(wanted) <= 8:
        reason += f": expected {' or '.join(wanted)}"
    return _error(source, reason, furthest)


_REFUSED = {
    "ConstructQuery": "CONSTRUCT is not supported: use SELECT, with STORE for a new map",
    "DescribeQuery": "DESCRIBE is not supported: use SELECT",
    "DatasetClause": "FROM is not supported: there is one catalogue",
    "GraphGraphPattern": "GRAPH is not supported: there is one catalogue",
    "QuadsNotTriples": "GRAPH is not supported: there is one catalogue",
    "ServiceGraphPattern": "SERVICE is not supported: put the other's answer into VALUES",
    "Collection": "lists are not supported: write a pattern for each item",
    "PathEltOrInverse": "property paths are not supported: turn subject and object round",
    "PathNegatedPropertySet": "property paths are not supported: use FILTER NOT EXISTS",
    "Aggregate_GroupConcat": "GROUP_CONCAT is not supported",
    **{
        name: f"{name.upper()} is not supported: INSERT and DELETE are"
        for name in ("Load", "Clear", "Drop", "Create", "Add", "Move", "Copy")
    },
    "UsingClause": "USING is not supported: there is one catalogue",
}


def _refusals(tree: Any) -> Iterator[tuple[str, Any]]:
    """What is in the grammar, but not in the language."""
    if isinstance(tree, CompValue):
        if tree.name in _REFUSED:
            yield _REFUSED[tree.name], tree
        if tree.name == "Modify" and tree.withClause is not None:
            yield "WITH is not supported: there is one catalogue", tree
        if tree.name == "PathElt" and tree.mod:
            yield "property paths are not supported: write a pattern for each step", tree
        if tree.name in ("PathSequence", "PathAlternative") and len(tree.part) > 1:
            mend = "a pattern for each step" if tree.name == "PathSequence" else "UNION"
            yield f"property paths are not supported: write {mend}", tree
        if tree.name in ("InlineData", "ValuesClause"):
            width = len(tree.var or ())
            for row in tree.value or ():
                if isinstance(row, (list, pyparsing.ParseResults)) and len(row) != width:
                    yield f"VALUES has {width} variables, but a row of {len(row)} values", tree
        for part in tree.values():
            yield from _refusals(part)
    elif isinstance(tree, (list, tuple, pyparsing.ParseResults)):
        for part in tree:
            yield from _refusals(part)


def _check(source: Normalised, tree: Any) -> None:
    refused = sorted(_refusals(tree), key=lambda one: place(one[1]) or 0)
    for reason, at in refused:
        raise _error(source, reason, at)


def _namer(source: Normalised, prologue: Any) -> Callable[[Any], Any]:
    """What turns prefixed names and literals into terms that keep their places."""

    def name(part: Any) -> Any:
        try:
            term = algebra.translatePName(part, prologue)
        except Exception as error:
            prefix = f"{part.get('prefix') if 'prefix' in part else ''}:"
            raise _error(
                source, f"the prefix {prefix} is not declared: begin with PREFIX {prefix} <...>",
                part,
            ) from error  # fmt: skip
        at = place(part)
        return term if term is None or at is None else _place("", at, [term])

    return name


@contextmanager
def _shallow(source: Normalised) -> Iterator[None]:
    """An error for a text whose parts are nested too deeply to be followed."""
    try:
        yield
    except RecursionError:
        raise _error(source, TOO_DEEP, 0) from None


@contextmanager
def _quiet() -> Iterator[None]:
    """Without what rdflib logs of a literal that is none of its type: it is refused where it is."""
    thread, logger = threading.get_ident(), logging.getLogger("rdflib.term")

    def elsewhere(record: logging.LogRecord) -> bool:
        return record.thread != thread

    logger.addFilter(elsewhere)
    try:
        yield
    finally:
        logger.removeFilter(elsewhere)


@lru_cache(maxsize=256)
def parse_query(text: str) -> Parsed:
    """The algebra of a query.

    Raises
    ------
    QueryError
        What is not SPARQL, or not of this language.
    """
    source = normalise(text)
    with _shallow(source), _quiet():
        return _query(source)


def _query(source: Normalised) -> Parsed:
    declarations, tree = _read(source, 0)
    _check(source, [tree])
    clauses = _split(source, tree)
    prologue = algebra.translatePrologue(declarations, None)
    name = _namer(source, prologue)
    tree = algebra.traverse(tree, visitPost=name)
    clauses = algebra.traverse(clauses, visitPost=name)
    _mark_everything(tree)
    translated, names = algebra.translate(tree)
    found = {clause.name: clause for clause in clauses}
    return Parsed(
        source,
        tree.name,
        translated,
        tuple(names),
        found["Store"].iri if "Store" in found else None,
        found["At"].moment if "At" in found else None,
        tuple(found["During"].bound) if "During" in found else (),
    )


def _split(source: Normalised, tree: CompValue) -> list[CompValue]:
    """The clauses that SPARQL does not have, taken out of the tree."""
    clauses: list[CompValue] = tree.pop("clause") if "clause" in tree else []
    words = {"Store": "STORE", "At": "AT", "During": "DURING"}
    seen: list[str] = []
    for clause in clauses:
        if clause.name in seen:
            raise _error(source, f"a second {words[clause.name]}: give one", clause)
        if clause.name != "Store" and {"At", "During"} & set(seen):
            raise _error(source, "AT and DURING are both given: give one", clause)
        if clause.name == "Store" and tree.name == "AskQuery":
            raise _error(source, "ASK has nothing to STORE: use SELECT", clause)
        seen.append(clause.name)
    return clauses


def _mark_everything(tree: Any) -> None:
    """Put a name for all variables where there is * or nothing: rdflib would take all of WHERE."""
    if isinstance(tree, CompValue):
        if tree.name in ("SelectQuery", "SubSelect", "AskQuery") and not tree.projection:
            name = Name(EVERYTHING)
            name.at = place(tree) or 0
            tree["projection"] = [CompValue("vars", var=name)]
        for part in tree.values():
            _mark_everything(part)
    elif isinstance(tree, (list, tuple, pyparsing.ParseResults)):
        for part in tree:
            _mark_everything(part)


def parse_update(text: str) -> Parsed:
    """The requests of an update.

    Raises
    ------
    QueryError
        What is not SPARQL, or not of this language.
    """
    source = normalise(text)
    with _shallow(source), _quiet():
        return _update(source)


def _update(source: Normalised) -> Parsed:
    (tree,) = _read(source, 1)
    _check(source, [tree])
    requests, prologue = [], None
    for declarations, request in zip(tree.prologue or (), tree.request or (), strict=False):
        prologue = algebra.translatePrologue(declarations, None, None, prologue)
        request = algebra.traverse(request, visitPost=_namer(source, prologue))
        request = algebra.traverse(request, visitPost=algebra._simplifyFilters)
        request = algebra.traverse(request, visitPost=algebra.translatePath)
        _mark_everything(request)
        requests.append(algebra.translateUpdate1(request, prologue))
    return Parsed(source, "Update", requests=tuple(requests))
