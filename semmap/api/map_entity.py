"""One entity of a map: what it is, where it is, what it holds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from psycopg.types.json import Jsonb

if TYPE_CHECKING:
    from semmap.api.map import Map
    from semmap.geometry.pose import Pose

__all__ = ["MapEntity"]


class MapEntity:
    """A room, object, region, agent, connector or storey of a map, read at each access.

    Two of them are equal if they are the same entity of the same database.

    Attributes
    ----------
    map : Map
    id : its number in the database, which its name may change but never it
    """

    def __init__(self, map: Map, id: int) -> None:
        self.map, self.id = map, id

    @property
    def name(self) -> str:
        """The name, unique in the map."""
        return str(self._value("name"))

    @property
    def kind(self) -> str:
        """``room``, ``object``, ``region``, ``agent``, ``connector``, ``storey``, ``elevator``."""
        return str(self._value("kind"))

    @property
    def type(self) -> str | None:
        """The semantic type."""
        return self._value("type")  # type: ignore[no-any-return]

    @type.setter
    def type(self, value: str | None) -> None:
        if value is not None:
            self.map.check_type(value)
        self._set("type", value)

    @property
    def label(self) -> str | None:
        """The property label, such as ``kitchen``."""
        return self._value("label")  # type: ignore[no-any-return]

    @label.setter
    def label(self, value: str | None) -> None:
        self._set("label", value)

    @property
    def properties(self) -> dict[str, Any]:
        """A copy of the properties; assign a dictionary to change them."""
        return dict(self._value("properties"))

    @properties.setter
    def properties(self, value: dict[str, Any]) -> None:
        self._set("properties", Jsonb(value))

    @property
    def holder(self) -> MapEntity | None:
        """What it is on or in; None where the map itself holds it."""
        row = self.map.execute("SELECT holder_id FROM placement WHERE entity_id = %s", self.id)
        return MapEntity(self.map, row[0][0]) if row and row[0][0] is not None else None

    @property
    def contents(self) -> list[MapEntity]:
        """What is on or in it, by name; not what that holds in its turn."""
        rows = self.map.execute(
            "SELECT e.id FROM placement p JOIN entity e ON e.id = p.entity_id "
            "WHERE p.holder_id = %s ORDER BY e.name",
            self.id,
        )
        return [MapEntity(self.map, row[0]) for row in rows]

    @property
    def pose(self) -> Pose | None:
        """The pose in the map's frame (metres, quaternion); None without a placement."""
        from semmap.geometry.pose import Pose

        row = self.map.execute("SELECT pose FROM world WHERE entity_id = %s", self.id)
        return Pose(*row[0][0]) if row else None

    def is_a(self, type: str) -> bool:
        """Whether it is of a semantic type or of one of its subtypes."""
        row = self.map.execute(
            "SELECT EXISTS (SELECT FROM object WHERE id = %s AND type = %s)", self.id, type
        )
        return bool(row[0][0])

    def describe(self) -> dict[str, Any]:
        """All that the map has of it, as ``semmap show`` prints it."""
        return self.map.describe(self.name)

    def move_to(self, x: float, y: float, z: float, yaw: float | None = None) -> None:
        """Move it; what it holds comes along, and the geometry says what holds it now.

        Parameters
        ----------
        x, y, z : metres, in the map's frame
        yaw : heading in radians; without it, it keeps its orientation

        Raises
        ------
        ValueError
            A number that is not finite, or an entity without a placement.
        """
        if not all(map(math.isfinite, (x, y, z, yaw or 0.0))):
            raise ValueError(f"{self.name} is moved to finite numbers, not {x}, {y}, {z}, {yaw}")
        if self.pose is None:
            raise ValueError(f"{self.name} has no placement, so it cannot be moved")
        self.map.execute("SELECT move_to(%s, %s, %s, %s, %s)", self.id, x, y, z, yaw)

    def put_on(self, holder: str | MapEntity) -> None:
        """Put it on the middle of an object's highest support surface, its orientation kept."""
        self._put(holder, "on")

    def put_in(self, holder: str | MapEntity) -> None:
        """Put it into the middle of a room, region or container, its orientation kept."""
        self._put(holder, "in")

    def delete(self) -> None:
        """Take it out of the map. What it held stays where it is."""
        self.map.execute("DELETE FROM entity WHERE id = %s", self.id)

    def _put(self, holder: str | MapEntity, relation: str) -> None:
        above = self.map[holder] if isinstance(holder, str) else holder
        x, y, z = self.map.spot(above, relation)
        low = self.map.execute(
            "SELECT ST_ZMin(box) - pose[3] FROM world WHERE entity_id = %s", self.id
        )
        height = z - (low[0][0] if low else 0.0)
        with self.map.transaction():
            self.map.execute("SELECT move_to(%s, %s, %s, %s)", self.id, x, y, height)
            self.map.execute("SELECT put(%s, %s, %s)", self.id, above.id, relation)

    def _value(self, column: str) -> Any:
        rows = self.map.execute(f"SELECT {column} FROM entity WHERE id = %s", self.id)
        if not rows:
            raise LookupError(f"the entity {self.id} is no longer in the map {self.map.name}")
        return rows[0][0]

    def _set(self, column: str, value: Any) -> None:
        self.map.execute(f"UPDATE entity SET {column} = %s WHERE id = %s", value, self.id)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, MapEntity):
            return NotImplemented
        return self.id == other.id and self.map.database is other.map.database

    def __hash__(self) -> int:
        return hash(self.id)

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name}>"
