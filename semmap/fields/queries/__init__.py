"""Queries and updates on fields: SPARQL with STORE, AT and DURING (reMap, section 4)."""

from semmap.fields.queries.query import query
from semmap.fields.queries.query_result import SelectResult, StoreResult, UpdateResult
from semmap.fields.queries.update import update
from semmap.language.error import QueryError

__all__ = ["QueryError", "SelectResult", "StoreResult", "UpdateResult", "query", "update"]
