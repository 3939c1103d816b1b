"""What a map says of space, in the terms of RDF (reMap, sections 3.1.2 and 4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Kind", "Property"]

Kind = Literal["voxel", "thing", "number"]
"""What stands on a side of a statement: a voxel, an entity or a semantic type, or a number."""


@dataclass(frozen=True)
class Property:
    """One property: what may have it, and what it says of it.

    Attributes
    ----------
    iri : its identifier
    name : the local name of `iri`
    domain : the semantic type of what a map of this property represents, or of its subjects where
        these are things
    range : the semantic type of its objects, or "number"; None is any type
    subject, object : what stands on either side
    same_as : other identifiers of the same property
    measure : the name of the property that tells how much, where a map has numbers besides
        (`inFieldOfView human1` holds or not; `attention` says how much)
    """

    iri: str
    name: str
    domain: str | None
    range: str | None
    subject: Kind
    object: Kind
    same_as: tuple[str, ...] = ()
    measure: str | None = None
