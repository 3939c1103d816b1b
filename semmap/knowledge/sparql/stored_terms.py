"""The terms of statements by their numbers: a number stands for one term for ever."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import psycopg
import rdflib

from semmap.knowledge.sparql.values import text_of
from semmap.knowledge.triple_map import Value
from semmap.knowledge.vocabulary import XSD

Term = rdflib.term.Identifier

NUMBER = "#"
"""The tag of an answer that has the number of a term in place of its text."""

READ = "SELECT id, text, tag FROM term WHERE id = ANY (%s::bigint[])"

_MOST = 2**15  # terms of a session

Read = Callable[[list[int]], Iterable[tuple[Any, ...]] | None]  # the rows of `READ`

_KNOWN: WeakKeyDictionary[psycopg.Connection[Any], dict[int, Term]] = WeakKeyDictionary()


class PrunedError(Exception):
    """A number of an answer stands for no term any more: ask again."""


def columns_with_numbers(value: Value, namespace: str) -> tuple[str, str]:
    """Return the SQL of a stored term's text and tag, of its number and `NUMBER` for a literal."""
    entity = text_of(Value("entity", value.sql), namespace)
    return (
        f"CASE WHEN {value.sql} > 0 THEN {entity} ELSE ({value.sql})::text END",
        f"CASE WHEN {value.sql} > 0 THEN 'I' WHEN {value.sql} < 0 THEN '{NUMBER}' END",
    )


def terms_of(session: psycopg.Connection[Any], numbers: set[int], read: Read) -> Mapping[int, Term]:
    """Return the terms of numbers; those that the session has not read yet are read."""
    known = _KNOWN.setdefault(session, {})
    missing = numbers - known.keys()
    if missing:
        if len(known) + len(missing) > _MOST:
            known = {n: known[n] for n in numbers & known.keys()}
        for number, text, tag in read(sorted(missing)) or ():
            term = term_of(text, tag)
            assert term is not None
            known[int(number)] = term
        if len(known) <= _MOST:
            _KNOWN[session] = known
        if not numbers <= known.keys():
            raise PrunedError
    return known


@lru_cache(maxsize=_MOST)
def iri_of(text: str) -> rdflib.URIRef:
    """Return an IRI; rdflib checks it, which takes longer than all else of a row."""
    return rdflib.URIRef(text)


def term_of(text: str | None, tag: str | None) -> Term | None:
    """Return the term of a text and a tag."""
    if text is None or tag is None:
        return None
    if tag == "I":
        return iri_of(text)
    if tag == "B":
        return rdflib.BNode(text)
    if tag.startswith("@"):
        return rdflib.Literal(text, lang=tag[1:])
    if tag == f"{XSD}string":
        return rdflib.Literal(text)
    return rdflib.Literal(text, datatype=rdflib.URIRef(tag), normalize=False)
