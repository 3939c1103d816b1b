"""The names that constants of a query may use: entities of a map, and semantic types."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from semmap.snake_case import snake_case
from semmap.suggestions import suggestion


@dataclass(frozen=True)
class NameIndex:
    """Entities with their semantic types, and types with the types that subsume them.

    >>> index = NameIndex({"mug7": "mug"}, {"mug": frozenset({"mug", "object"})}, {"cup": "mug"})
    >>> sorted(index.find("Cup"))
    ['mug', 'mug7']
    """

    # the type of each entity; None where it has none
    entities: Mapping[str, str | None] = field(default_factory=dict)
    # for each type all types that subsume it, itself included
    supertypes: Mapping[str, frozenset[str]] = field(default_factory=dict)
    # other words for types, in snake case, with the type
    synonyms: Mapping[str, str] = field(default_factory=dict)

    def is_a(self, type_: str | None, supertype: str) -> bool:
        """Return whether a type is subsumed by another; True for an unknown type."""
        known = None if type_ is None else self.supertypes.get(type_)
        return known is None or supertype in known

    def subtypes(self, type_: str) -> frozenset[str]:
        """Return the types that a type subsumes, itself included."""
        return frozenset(name for name, supers in self.supertypes.items() if type_ in supers)

    def find(
        self,
        name: str,
        range_: str | None = None,
        others: Mapping[str, str | None] | None = None,
    ) -> frozenset[str]:
        """Return what a name stands for, of a type if given; raises LookupError, TypeError.

        An entity stands for itself, also one of `others` with their types; a type for itself, its
        subtypes and their entities. Types may be written in any case, or by a synonym.
        """
        entities = {**(others or {}), **self.entities}
        found: set[str] = set()
        known = False
        if name in entities:
            known = True
            if range_ is None or self.is_a(entities[name], range_):
                found.add(name)
        type_ = self._type(name)
        if type_ is not None:
            known = True
            below = self.subtypes(type_)
            if range_ is None or self.is_a(type_, range_) or range_ in below:
                found |= below
                found |= {entity for entity, of in entities.items() if of in below}
        if found:
            return frozenset(found)
        if known:
            raise TypeError(f"{name} is not of the type {range_}")
        similar = suggestion(name, [*entities, *self.supertypes])
        raise LookupError(f"there is no entity and no type {name}{similar}")

    def _type(self, word: str) -> str | None:
        name = snake_case(word)
        return name if name in self.supertypes else self.synonyms.get(name)
