"""The SPARQL front end: it parses a text and checks it against a schema, for any back end.

A back end gives a `Schema` (its properties, and the entities that names stand for) and evaluates
the checked algebra. The back end for fields is `semmap.fields.queries`. The language is SPARQL 1.1
with the clauses STORE, AT and DURING; it accepts the notation of reMap (section 4), too.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

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


def __getattr__(name: str) -> Any:
    """Load a name from its module when it is first used: a command loads only what it needs."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__} has no attribute {name}")
