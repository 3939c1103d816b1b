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
    """An RDF property: what may have it, and which values it takes (reMap, 3.1.2 and 4).

    Attributes
    ----------
    iri : its identifier
    name : the local name of `iri`
    domain : the semantic type of its subjects where these are entities; for voxels, the type of
        what a map of this property represents. None is any type
    range : the semantic type of its objects; None is any type
    subject, object : the kind of either side
    same_as : other identifiers of the same property
    measure : the name of the property for the degree, where a map may have numbers in place of
        true or false (`inFieldOfView human1` is true or not; `attention` is its degree)
    """

    iri: str
    name: str
    domain: str | None
    range: str | None
    subject: SideKind
    object: SideKind
    same_as: tuple[str, ...] = ()
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
        """Return the property of an IRI.

        Raises LookupError: there is no such property; the error suggests similar names.
        """
        ...

    def properties(self) -> Iterable[Property]:
        """Return all properties."""
        ...

    def find_entities(self, name: str, range_: str | None) -> frozenset[str]:
        """Return what a constant stands for, of the semantic type `range_` if given.

        An entity stands for itself, a semantic type for itself, its subtypes and their entities.
        Raises LookupError: there is no such entity or type. Raises TypeError: it is not of the type
        `range_`.
        """
        ...


def with_article(kind: ValueKind) -> str:
    """Return the name of a kind as errors write it.

    Examples
    --------
    >>> with_article("entity"), with_article("boolean")
    ('an entity', 'a truth value')
    """
    return {"boolean": "a truth value", "text": "text", "entity": "an entity"}.get(
        kind, f"a {kind}"
    )
