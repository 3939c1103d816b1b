"""The entities of one kind of a map: by name, in order of their names."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from semmap.api.checked import EntityName, checked_class
from semmap.api.map_questions import MapQuestions
from semmap.suggestions import suggestion

if TYPE_CHECKING:
    from semmap.api.map_entity import Door, MapEntity

Kind = TypeVar("Kind", bound="MapEntity")


@checked_class
class EntityCollection(Generic[Kind]):
    """The rooms (objects, doors, ...) of a map, read at each access: ``house.rooms["kitchen"]``."""

    def __init__(self, map: MapQuestions, kind: str, word: str) -> None:
        self._map, self._kind, self._word = map, kind, word

    def __getitem__(self, name: EntityName) -> Kind:
        """The entity of a name; LookupError names those that come near it."""
        rows = self._rows("AND name = %s", name)
        if not rows:
            known = [row[2] for row in self._rows()]
            hint = suggestion(name, known, f"Map.{self._word} has them all")
            raise LookupError(f"the map has no {self._word.removesuffix('s')} {name}{hint}")
        return self._entity(*rows[0])

    def __contains__(self, name: object) -> bool:
        """Whether a name, or an entity of this map, is among them."""
        return any(
            name == (row[2] if isinstance(name, str) else self._entity(*row))
            for row in self._rows(*(("AND name = %s", name) if isinstance(name, str) else ()))
        )

    def __iter__(self) -> Iterator[Kind]:
        """Each of them, by name."""
        return iter([self._entity(*row) for row in self._rows()])

    def __len__(self) -> int:
        """How many there are."""
        return int(self._execute("count(*)")[0][0])

    def __repr__(self) -> str:
        names = [row[2] for row in self._rows("ORDER BY name LIMIT 5")]
        count = len(self) if len(names) == 5 else len(names)
        more = ", ..." if count > len(names) else ""
        word = self._word.removesuffix("s") if count == 1 else self._word
        return f"<{count} {word}: {', '.join(names)}{more}>" if names else f"<0 {word}>"

    def _rows(self, condition: str = "ORDER BY name", *values: Any) -> list[tuple[Any, ...]]:
        return self._execute("id, kind, name", condition, *values)

    def _execute(self, columns: str, condition: str = "", *values: Any) -> list[tuple[Any, ...]]:
        return self._map._rows(
            f"SELECT {columns} FROM entity WHERE map_id = current_map() AND kind = %s {condition}",
            self._kind,
            *values,
        )

    def _entity(self, id: int, kind: str, name: str) -> Kind:
        return cast("Kind", self._map.entity(id, kind, name))


class MapCollections(MapQuestions):
    """The part of `Map` that has its entities by kinds."""

    @property
    def rooms(self) -> EntityCollection[MapEntity]:
        """The rooms, by name."""
        return self._of("room", "rooms")

    @property
    def objects(self) -> EntityCollection[MapEntity]:
        """The objects, by name."""
        return self._of("object", "objects")

    @property
    def doors(self) -> EntityCollection[Door]:
        """The doors, and all else that leads from a place to another: stairs, ramps."""
        return self._of("connector", "doors")

    @property
    def storeys(self) -> EntityCollection[MapEntity]:
        """The storeys, by name."""
        return self._of("storey", "storeys")

    @property
    def regions(self) -> EntityCollection[MapEntity]:
        """The regions, by name."""
        return self._of("region", "regions")

    @property
    def agents(self) -> EntityCollection[MapEntity]:
        """The robots and people, by name."""
        return self._of("agent", "agents")

    def _of(self, kind: str, word: str) -> EntityCollection[Any]:
        return EntityCollection(self, kind, word)
