"""The SPARQL front end: it parses a text and checks it against a schema, for any back end.

A back end gives a `Schema` (its properties, and the entities that names stand for) and evaluates
the checked algebra. The back end for fields is `semmap.fields.queries`. The language is SPARQL 1.1
with the clauses STORE, AT and DURING; it accepts the notation of reMap (section 4), too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.language.checker import Checker
    from semmap.language.error import QueryError
    from semmap.language.parser import ParsedText, parse_query, parse_update
    from semmap.language.schema import Function, Property, Schema

__all__ = [
    "Checker",
    "Function",
    "ParsedText",
    "Property",
    "QueryError",
    "Schema",
    "parse_query",
    "parse_update",
]

_HOMES = {
    "Checker": "semmap.language.checker",
    "Function": "semmap.language.schema",
    "ParsedText": "semmap.language.parser",
    "Property": "semmap.language.schema",
    "QueryError": "semmap.language.error",
    "Schema": "semmap.language.schema",
    "parse_query": "semmap.language.parser",
    "parse_update": "semmap.language.parser",
}

__getattr__ = load_on_use(__name__, _HOMES)
