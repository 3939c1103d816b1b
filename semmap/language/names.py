"""What things are called: entities, and the semantic types that constants of a query may name."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches

from semmap.ingest.tbox import TypeRecord, snake_case

__all__ = ["Names"]


@dataclass(frozen=True)
class Names:
    """Entities with their types, and types with what subsumes them.

    Attributes
    ----------
    entities : the type of each entity, None where it has none
    supers : all types that subsume a type, itself among them
    synonyms : other words for a type
    """

    entities: Mapping[str, str | None] = field(default_factory=dict)
    supers: Mapping[str, frozenset[str]] = field(default_factory=dict)
    synonyms: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of_tbox(
        cls, records: Iterable[TypeRecord], entities: Mapping[str, str | None] | None = None
    ) -> Names:
        """From a T-Box as `read_tbox` gives it: each type after its parents."""
        supers: dict[str, frozenset[str]] = {}
        synonyms = {}
        for record in records:
            supers[record.name] = frozenset({record.name}).union(
                *(supers[parent] for parent in record.parents)
            )
            for word in (record.label, *record.synonyms):
                synonyms[snake_case(word)] = record.name
        return cls(dict(entities or {}), supers, synonyms)

    def is_a(self, type_: str | None, super_: str) -> bool:
        """Whether a type is subsumed by another; one that is not known may be anything."""
        return type_ is None or type_ not in self.supers or super_ in self.supers[type_]

    def subtypes(self, type_: str) -> frozenset[str]:
        """The types that a type subsumes, itself among them."""
        return frozenset(name for name, supers in self.supers.items() if type_ in supers)

    def things(
        self, name: str, range_: str | None, also: Mapping[str, str | None]
    ) -> frozenset[str]:
        """The entities and types that a word names, as `Catalogue.things` has it.

        Parameters
        ----------
        also : things that only maps know, with the type that their property gives them
        """
        entities = {**also, **self.entities}
        found: set[str] = set()
        misfit: set[str] = set()
        if name in entities:
            fits = range_ is None or self.is_a(entities[name], range_)
            (found if fits else misfit).add(name)
        type_ = self._type(name)
        if type_ is not None:
            below = self.subtypes(type_)
            if range_ is None or self.is_a(type_, range_) or range_ in below:
                found |= below
                found |= {e for e, of in entities.items() if of in below}
            else:
                misfit.add(type_)
        if found:
            return frozenset(found)
        if misfit:
            raise TypeError(f"{name} is no {range_}")
        raise LookupError(f"there is no entity and no type {name}{self._near(name, entities)}")

    def _type(self, word: str) -> str | None:
        name = snake_case(word)
        return name if name in self.supers else self.synonyms.get(name)

    def _near(self, name: str, entities: Collection[str]) -> str:
        near = get_close_matches(name, [*entities, *self.supers], n=3)
        return f"; near it: {', '.join(near)}" if near else ""
