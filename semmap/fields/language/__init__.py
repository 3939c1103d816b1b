"""The query language over fields: SPARQL with STORE, AT and DURING (reMap, section 4)."""

from semmap.fields.language.answer import Rows, Stored, query
from semmap.fields.language.error import QueryError
from semmap.fields.language.update import Updated, update

__all__ = ["QueryError", "Rows", "Stored", "Updated", "query", "update"]
