"""From the text of a query or update to SPARQL's algebra, by rdflib."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import rdflib
from rdflib.plugins.sparql import algebra
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.language.error import TOO_DEEP, QueryError
from semmap.language.grammar import Form, read_syntax
from semmap.language.named_graphs import require_graphs
from semmap.language.normalise import NormalisedText, normalise
from semmap.language.refusals import refuse_unsafe, refuse_unsupported
from semmap.language.scopes import ScopeChecker
from semmap.language.syntax_tree import nodes_in
from semmap.language.terms import (
    EVERYTHING,
    Iri,
    Literal,
    Variable,
    position_of,
    with_position,
)

Prefixes = tuple[tuple[str, str], ...]
"""Prefixes with their namespaces that a text need not declare."""


@dataclass(frozen=True)
class ParsedText:
    """A query or an update as SPARQL's algebra."""

    text: NormalisedText  # the text, for errors
    form: str  # "SelectQuery", "AskQuery" or "Update"
    algebra: Any = None  # rdflib's algebra of a query
    # the variables that a query projects, in order; EVERYTHING for all
    names: tuple[rdflib.Variable, ...] = ()
    store: Iri | None = None  # the property after STORE
    moment: Literal | None = None  # the literal after AT
    span: tuple[Literal, ...] = ()  # the one or two literals after DURING
    requests: tuple[Any, ...] = ()  # rdflib's algebra of each request of an update
    dataset: tuple[Any, ...] = ()  # the clauses FROM and FROM NAMED of a query
    # what a back end has made of the text, by its own keys
    kept: dict[Any, Any] = field(default_factory=dict, compare=False, repr=False)

    @property
    def triple(self) -> tuple[Any, Any, Any] | None:
        """The one triple pattern that a query consists of; None where it has more or others."""
        node = self.algebra
        while node.name in ("SelectQuery", "AskQuery", "Project"):
            node = node.p
        return node.triples[0] if node.name == "BGP" and len(node.triples) == 1 else None

    def error(self, reason: str, at: object) -> QueryError:
        """Return an error at a term, at a part of the tree, or at a position."""
        position = at if isinstance(at, int) else position_of(at)
        return self.text.error(reason, position or 0)


FIELD_PREFIXES = {"": "urn:semmap:ontology#"}  # prefixes that a text about fields need not declare


@lru_cache(maxsize=256)
def parse_query(text: str) -> ParsedText:
    """Parse a query of fields; raises QueryError."""
    normalised = normalise(text)
    with _errors_of(normalised):
        declarations, tree = read_syntax(normalised, "query")
        refuse_unsupported(normalised, [tree])
        clauses = _take_clauses(normalised, tree)
        resolve = _resolver(
            normalised, algebra.translatePrologue(declarations, None, FIELD_PREFIXES)
        )
        tree = algebra.traverse(tree, visitPost=resolve)
        ScopeChecker(normalised).check_query(tree)
        clauses = algebra.traverse(clauses, visitPost=resolve)
        _mark_everything(tree)
        translated, names = algebra.translate(tree)
    found = {clause.name: clause for clause in clauses}
    return ParsedText(
        normalised,
        tree.name,
        translated,
        tuple(names),
        found["Store"].iri if "Store" in found else None,
        found["At"].moment if "At" in found else None,
        tuple(found["During"].bound) if "During" in found else (),
    )


def parse_update(text: str) -> ParsedText:
    """Parse an update of fields; raises QueryError."""
    normalised = normalise(text)
    with _errors_of(normalised):
        (tree,) = read_syntax(normalised, "update")
        refuse_unsupported(normalised, [tree])
        _mark_everything(tree)
        requests = tuple(_requests(normalised, tree, tuple(FIELD_PREFIXES.items())))
    return ParsedText(normalised, "Update", requests=requests)


@lru_cache(maxsize=256)
def parse_sparql(text: str, form: Form, prefixes: Prefixes = ()) -> ParsedText:
    """Parse a text in all of SPARQL 1.1, which may not leave the database; raises QueryError."""
    normalised = normalise(text)
    with _errors_of(normalised):
        tree = read_syntax(normalised, form, whole=True)
        refuse_unsafe(normalised, tree)
        if form == "update":
            (update,) = tree
            requests = tuple(_requests(normalised, update, prefixes))
            return ParsedText(normalised, "Update", requests=requests)
        declarations, tree = tree
        prologue = algebra.translatePrologue(declarations, None, dict(prefixes))
        tree = algebra.traverse(tree, visitPost=_resolver(normalised, prologue))
        visible = ScopeChecker(normalised).check_query(tree)
        if tree.name == "DescribeQuery" and not tree.var:  # rdflib cannot translate DESCRIBE *
            tree["var"] = [rdflib.Variable(name) for name in sorted(visible)]
        everything = tree.name == "SelectQuery" and not tree.projection
        try:
            pattern, names = algebra.translate(tree)
        except QueryError:
            raise
        except Exception as error:  # rdflib raises Exception itself for variables used twice
            raise normalised.error(str(error), 0) from error
        if everything:
            names = sorted(names, key=lambda name: position_of(name) or 0)
        template = algebra.triples(tree.template) if tree.template else None
        whole = CompValue(tree.name, p=pattern, PV=names, template=template)
        whole = algebra.traverse(whole, visitPost=algebra.simplify)
        require_graphs(whole)
    dataset = tuple(tree.datasetClause or ())
    return ParsedText(normalised, tree.name, whole, tuple(names), dataset=dataset)


def _requests(text: NormalisedText, tree: Any, prefixes: Prefixes) -> Iterator[Any]:
    """Yield the algebra of each request of an update."""
    prologue, checker = None, ScopeChecker(text)
    for declarations, request in zip(tree.prologue or (), tree.request or (), strict=False):
        known = dict(prefixes) if prologue is None else None
        prologue = algebra.translatePrologue(declarations, None, known, prologue)
        request = algebra.traverse(request, visitPost=_resolver(text, prologue))
        checker.check_request(request)
        request = algebra.traverse(request, visitPost=algebra._simplifyFilters)
        request = algebra.traverse(request, visitPost=algebra.translatePath)
        translated = algebra.translateUpdate1(request, prologue)
        require_graphs(translated.where)
        yield translated


_AGGREGATES = "http://www.opengis.net/def/function/geosparql/agg"
"""The functions of a group: the grammar cannot tell them from others (GeoSPARQL 1.1)."""


_LISTS = {"RelationalExpression": "other", "Builtin_COALESCE": "arg"}
"""The operands that may be a list of expressions."""


def _resolver(text: NormalisedText, prologue: Any) -> Callable[[Any], Any]:
    """Return a function from prefixed names and literals to terms that know their positions."""

    def resolve(part: Any) -> Any:
        if getattr(part, "name", "") in ("Builtin_IRI", "Builtin_URI") and prologue.base:
            part["base"] = rdflib.URIRef(prologue.base)
        if getattr(part, "name", "") == "Function" and str(part.iri).startswith(_AGGREGATES):
            name = str(part.iri).rpartition("/")[2]
            return CompValue(f"Aggregate_{name}", vars=part.expr[0], distinct=part.distinct)
        if getattr(part, "name", "") == "GroupAs" and part.var is None:
            return _innermost(part.expr)  # rdflib groups by None
        if getattr(part, "name", "") in _LISTS:
            operand = _LISTS[part.name]
            if isinstance(getattr(part, operand), rdflib.URIRef):  # rdf:nil, for ()
                part[operand] = []
        if getattr(part, "name", "") == "Filter" and not _innermost(part.expr):
            # rdflib drops a filter whose expression is falsy in Python: FILTER(false), FILTER(0)
            part["expr"] = CompValue("ConditionalAndExpression", expr=part.expr, other=[])
        try:
            term = algebra.translatePName(part, prologue)
        except Exception as error:
            prefix = f"{part.get('prefix') if 'prefix' in part else ''}:"
            reason = f"the prefix {prefix} is not declared: begin with PREFIX {prefix} <...>"
            raise text.error(reason, position_of(part) or 0) from error
        position = position_of(part)
        return term if term is None or position is None else with_position(term, position)

    return resolve


def _innermost(tree: Any) -> Any:
    """Return what the levels of precedence around a single operand contain."""
    while getattr(tree, "name", "").endswith("Expression") and list(tree) == ["expr"]:
        tree = tree.expr
    return tree


def _take_clauses(text: NormalisedText, tree: CompValue) -> list[CompValue]:
    """Remove the clauses STORE, AT and DURING from the tree, and return them."""
    clauses: list[CompValue] = tree.pop("clause") if "clause" in tree else []
    seen: list[str] = []
    for clause in clauses:
        position = position_of(clause) or 0
        if clause.name in seen:
            raise text.error(f"{clause.name.upper()} is given twice: give it once", position)
        if clause.name != "Store" and {"At", "During"} & set(seen):
            raise text.error("AT and DURING are both given: give one of them", position)
        if clause.name == "Store" and tree.name == "AskQuery":
            raise text.error("ASK has nothing to STORE: use SELECT", position)
        seen.append(clause.name)
    return clauses


def _mark_everything(tree: Any) -> None:
    """Put EVERYTHING where a projection is empty: rdflib would project all variables of WHERE."""
    for part in nodes_in(tree):
        of_select = getattr(part, "name", "") in ("SelectQuery", "SubSelect", "AskQuery")
        if of_select and not part.projection:
            variable = with_position(Variable(EVERYTHING), position_of(part) or 0)
            part["projection"] = [CompValue("vars", var=variable)]


@contextmanager
def _errors_of(text: NormalisedText) -> Iterator[None]:
    """Report too deep nesting as an error of a text; drop rdflib's log of ill-typed literals."""
    thread, logger = threading.get_ident(), logging.getLogger("rdflib.term")

    def of_another_thread(record: logging.LogRecord) -> bool:
        return record.thread != thread

    logger.addFilter(of_another_thread)
    try:
        yield
    except RecursionError:
        raise text.error(TOO_DEEP, 0) from None
    finally:
        logger.removeFilter(of_another_thread)
