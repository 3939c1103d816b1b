"""Small integers for entities: the native region map counts entities from 0."""

from __future__ import annotations

from collections.abc import Hashable, Iterable


class EntityNumbers:
    """A number for each entity; numbers of released entities are used again."""

    def __init__(self) -> None:
        self._number: dict[Hashable, int] = {}
        self._entity: list[Hashable] = []
        self._free: list[int] = []

    def __contains__(self, entity: object) -> bool:
        return entity in self._number

    def __len__(self) -> int:
        return len(self._number)

    def entities(self) -> set[Hashable]:
        """Return the entities that have numbers."""
        return set(self._number)

    def find(self, entity: Hashable) -> int | None:
        """Return the number of an entity; None if it has none."""
        return self._number.get(entity)

    def assign(self, entity: Hashable) -> int:
        """Return the number of an entity; a new entity gets an unused number."""
        number = self._number.get(entity)
        if number is None:
            if self._free:
                number = self._free.pop()
                self._entity[number] = entity
            else:
                number = len(self._entity)
                self._entity.append(entity)
            self._number[entity] = number
        return number

    def release(self, entity: Hashable) -> None:
        """Take its number from an entity."""
        number = self._number.pop(entity)
        self._entity[number] = None
        self._free.append(number)

    def entity(self, number: int) -> Hashable:
        """Return the entity of a number."""
        return self._entity[number]

    def named(self, numbers: Iterable[int]) -> list[Hashable]:
        """Return the entities of several numbers."""
        return [self._entity[number] for number in numbers]
