"""The query language over fields: SPARQL with STORE, AT and DURING (reMap, section 4)."""

from semmap.fields.queries.query import Rows, Stored, query
from semmap.language.error import QueryError
from semmap.fields.queries.update import Updated, update

__all__ = ["QueryError", "Rows", "Stored", "Updated", "query", "update"]
