"""A connector of a map: a door, elevator door, stairs or a ramp."""

from __future__ import annotations

from typing import Any

from semmap.api.map_entity import MapEntity

STATES = ("open", "closed", "locked")


class Door(MapEntity):
    """An entity of the kind ``connector``: it leads from a place to another."""

    @property
    def state(self) -> str:
        """``open``, ``closed`` or ``locked``."""
        return str(self._joins("state"))

    @state.setter
    def state(self, value: str) -> None:
        if value not in STATES:
            raise ValueError(f'{self.name}: state "{value}" is not one of {", ".join(STATES)}')
        self.map.execute("UPDATE connector SET state = %s WHERE entity_id = %s", value, self.id)

    @property
    def form(self) -> str:
        """``door``, ``elevator_door``, ``stairs`` or ``ramp``."""
        return str(self._joins("form"))

    @property
    def width(self) -> float | None:
        """Of the clear opening, metres; None where it is unknown."""
        return self._joins("width")  # type: ignore[no-any-return]

    @property
    def places(self) -> tuple[MapEntity, MapEntity | None]:
        """The two places that it joins; None is the outside."""
        rows = self.map.execute(
            "SELECT e.id, e.kind, e.name FROM connector c "
            "CROSS JOIN LATERAL (VALUES (1, c.place_a), (2, c.place_b)) s (side, place) "
            "LEFT JOIN entity e ON e.id = s.place WHERE c.entity_id = %s ORDER BY s.side",
            self.id,
        )
        if not rows:
            raise self._gone()
        first, second = (None if row[0] is None else self.map.entity(*row) for row in rows)
        assert first is not None
        return first, second

    def _joins(self, column: str) -> Any:
        rows = self.map.execute(f"SELECT {column} FROM connector WHERE entity_id = %s", self.id)
        if not rows:
            raise self._gone()
        return rows[0][0]
