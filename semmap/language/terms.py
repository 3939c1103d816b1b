"""Terms of a query that know their position in the text, and what names and numbers they are."""

from __future__ import annotations

import math
from decimal import Decimal
from typing import Any

import rdflib

from semmap.snake_case import local_name

EVERYTHING = "*"  # the name that stands for all visible variables

PAPER_NAMESPACE = "http://kb.openrobots.org/"  # the namespace of the examples in reMap


class _Placed:
    position: int  # in the text


class Iri(_Placed, rdflib.URIRef):
    """An IRI and its position in the text."""


class Literal(_Placed, rdflib.Literal):
    """A literal and its position in the text."""


class Variable(_Placed, rdflib.Variable):
    """A variable and its position in the text."""


class BlankNode(_Placed, rdflib.BNode):
    """A blank node and its position in the text."""


_TERMS: tuple[tuple[type, type[Any]], ...] = (
    (rdflib.URIRef, Iri),
    (rdflib.Literal, Literal),
    (rdflib.Variable, Variable),
    (rdflib.BNode, BlankNode),
)


def position_of(term: object) -> int | None:
    """Return the position of a term or part of the tree; None if the translation added it."""
    position = getattr(term, "position", None)
    return position if isinstance(position, int) else None


def with_position(term: object, position: int) -> Any:
    """Return a copy of a term that knows its position; a part of the tree is changed in place."""
    from rdflib.plugins.sparql.parserutils import CompValue  # with it comes the SPARQL grammar

    if isinstance(term, CompValue):
        term.position = position
        return None
    for kind, placed in _TERMS:
        if isinstance(term, kind):
            copy = placed(term)
            copy.position = position
            return copy
    return None


def name_of(term: object) -> str | None:
    """Return the local name of an IRI or the text of a plain literal; None for other terms."""
    if isinstance(term, rdflib.URIRef):
        return local_name(str(term))
    if isinstance(term, rdflib.Literal) and term.datatype in (None, rdflib.XSD.string):
        return str(term)
    return None


def number_of(term: object) -> float | None:
    """Return the value of a numeric literal; None for other terms."""
    value = term.value if isinstance(term, rdflib.Literal) else None
    if isinstance(value, bool) or not isinstance(value, (int, float, Decimal)):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
