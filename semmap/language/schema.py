"""What a back end offers to queries: its properties, functions, and the names of entities."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

SideKind = Literal["voxel", "entity", "number"]
"""What stands on a side of a statement. An "entity" is an entity of the map or a semantic type."""

ValueKind = Literal["voxel", "entity", "number", "boolean", "text"]
"""What a variable or an expression stands for; no variable stands for two kinds."""


@dataclass(frozen=True)
class Property:
    """An RDF property: what may have it, and which values it takes (reMap, 3.1.2 and 4)."""

    iri: str  # its identifier
    name: str  # the local name of `iri`
    domain: str | None  # semantic type of subjects; for voxels, of what a map represents. None: any
    range: str | None  # semantic type of objects; None is any type
    subject: SideKind
    object: SideKind
    same_as: tuple[str, ...] = ()  # other identifiers
    # the property for the degree, as `attention` of `inFieldOfView human1`
    measure: str | None = None


@dataclass(frozen=True)
class Function:
    """The signature of a function that expressions may call."""

    name: str  # local name of its IRI
    arguments: tuple[ValueKind, ...]  # kinds of its arguments
    result: ValueKind  # kind of its result


SPARQL_FUNCTIONS: Mapping[str, Function] = {
    each.name: each
    for each in (
        Function("ABS", ("number",), "number"),
        Function("CEIL", ("number",), "number"),
        Function("FLOOR", ("number",), "number"),
        Function("ROUND", ("number",), "number"),
        Function("STRLEN", ("text",), "number"),
        Function("UCASE", ("text",), "text"),
        Function("LCASE", ("text",), "text"),
        Function("STRSTARTS", ("text", "text"), "boolean"),
        Function("STRENDS", ("text", "text"), "boolean"),
        Function("CONTAINS", ("text", "text"), "boolean"),
    )
}
"""The functions of SPARQL (1.1, section 17.4) that the evaluator of fields and SQL both have.

Each has a meaning on columns in `semmap.fields.queries.expressions`, and one in SQL in
`semmap.knowledge.sparql.expressions`; a test runs both.
"""


class Schema(Protocol):
    """What queries may name."""

    @property
    def functions(self) -> Mapping[str, Function]:
        """Functions by local name, besides those of SPARQL."""
        ...

    def find_property(self, iri: str) -> Property:
        """Return the property of an IRI; or LookupError, which suggests similar names."""
        ...

    def properties(self) -> Iterable[Property]:
        """Return all properties."""
        ...

    def find_entities(self, name: str, range_: str | None) -> frozenset[str]:
        """Return what a constant stands for, as `NameIndex.find`."""
        ...


def with_article(kind: ValueKind) -> str:
    """Return the name of a kind as errors write it."""
    return {"boolean": "a truth value", "text": "text", "entity": "an entity"}.get(
        kind, f"a {kind}"
    )
