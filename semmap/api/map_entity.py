"""One entity of a map: what it is, where it is, what it holds; and doors, which join places."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any

from psycopg.errors import UniqueViolation
from psycopg.types.json import Jsonb

from semmap.api.checked import Properties, checked_class
from semmap.error import InvalidArgumentError, RightsError

if TYPE_CHECKING:
    from datetime import datetime

    import shapely
    import trimesh

    from semmap.api.map import Map
    from semmap.geometry.pose import Pose
    from semmap.query.placements import EntityVersion


FIXED = ("connector", "elevator", "storey")
"""Kinds of entities that are parts of the building."""


@checked_class
class MapEntity:
    """A room, object, region, agent, connector or storey of a map, read at each access.

    Its `id`, a number in the database, and its `kind` (``room``, ``object``, ``region``, ``agent``,
    ``connector``, ``storey``, ``elevator``) never change. Two are equal if they are the same entity
    of the same database.
    """

    def __init__(self, map: Map, id: int, kind: str, name: str) -> None:
        self.map, self.id, self.kind = map, id, kind
        self._name = name

    @property
    def name(self) -> str:
        """The name, unique in the map, as it was when anything of the entity was last read.

        Assign one to rename it.
        """
        return self._name

    @name.setter
    def name(self, name: str) -> None:
        if not name:
            raise ValueError(f"{self.name}: a name is not empty")
        from semmap.ingest.world import NOT_OUTSIDE, OUTSIDE

        if name == OUTSIDE:
            raise ValueError(NOT_OUTSIDE)
        try:
            self._set("name", name)
        except InvalidArgumentError as error:
            if not isinstance(error.__cause__, UniqueViolation):
                raise
            raise ValueError(f"the map has an entity {name} already") from None
        self._name = name

    @property
    def type(self) -> str | None:
        """The semantic type."""
        return self._value("type")  # type: ignore[no-any-return]

    @type.setter
    def type(self, type: str | None) -> None:
        if type is not None:
            self.map.check_type(type)
        self._set("type", type)

    @property
    def label(self) -> str | None:
        """The property label, such as ``kitchen``."""
        return self._value("label")  # type: ignore[no-any-return]

    @label.setter
    def label(self, label: str | None) -> None:
        self._set("label", label)

    @property
    def properties(self) -> dict[str, Any]:
        """A copy of the properties; assign a dictionary to change them."""
        return dict(self._value("properties"))

    @properties.setter
    def properties(self, properties: Properties) -> None:
        self._set("properties", Jsonb(dict(properties)))

    @property
    def holder(self) -> MapEntity | None:
        """The entity that it is on or in; None where the map itself holds it."""
        return self._other(
            "SELECT e.id, e.kind, e.name FROM placement p JOIN entity e ON e.id = p.holder_id "
            "WHERE p.entity_id = %s"
        )

    @property
    def relation(self) -> str | None:
        """How its holder holds it: ``in`` or ``on``; None where the map itself holds it."""
        rows = self.map._rows(
            "SELECT relation FROM placement WHERE entity_id = %s AND holder_id IS NOT NULL", self.id
        )
        return rows[0][0] if rows else None

    @property
    def room(self) -> MapEntity | None:
        """The room of its place, else that of its holder; None outside, and of a room."""
        return self._other(
            "SELECT r.id, r.kind, r.name FROM entity e JOIN entity r ON r.id = room_of(e.id) "
            "WHERE e.id = %s AND r.id <> e.id"
        )

    @property
    def storey(self) -> MapEntity | None:
        """The storey that it is on; None where no storey holds it, and of a storey."""
        return self._other(
            "SELECT e.id, e.kind, e.name FROM world w JOIN entity e ON e.id = w.storey_id "
            "WHERE w.entity_id = %s AND w.storey_id <> w.entity_id"
        )

    @property
    def contents(self) -> list[MapEntity]:
        """The entities on or in it, by name; not those that they hold in their turn."""
        rows = self.map._rows(
            "SELECT e.id, e.kind, e.name FROM placement p JOIN entity e ON e.id = p.entity_id "
            "WHERE p.holder_id = %s ORDER BY e.name",
            self.id,
        )
        return [self.map.entity(*row) for row in rows]

    @property
    def pose(self) -> Pose | None:
        """The pose in the map's frame (metres, quaternion); None without a placement."""
        from semmap.geometry.pose import Pose

        row = self.map._rows("SELECT pose FROM world WHERE entity_id = %s", self.id)
        return Pose(*row[0][0]) if row else None

    # --- its shape, in the map's frame, metres

    @property
    def geometry(self) -> shapely.Geometry | None:
        """The 2D shape that a GIS shows.

        Rooms, objects, agents, storeys and regions have their outline, as `footprint`. A door has
        the line of its opening from post to post, stairs and ramps the line along the way. What has
        no outline has the point of its pose, and None without a placement.
        """
        return self._shown()["geometry"]

    @property
    def footprint(self) -> shapely.Polygon | shapely.MultiPolygon | None:
        """The ground that it covers: that of a mesh to a centimetre; None without geometry.

        Of a door, the ground of its closed leaf, where it has one.
        """
        from semmap.query.entity_shapes import read_footprint

        return read_footprint(self.map._seen, self.id)

    @property
    def mesh(self) -> trimesh.Trimesh | None:
        """Its triangles in the map's frame; None where it has none or no placement."""
        from semmap.query.entity_shapes import read_mesh

        return read_mesh(self.map._seen, self.id)

    @property
    def size(self) -> tuple[float, float, float] | None:
        """The extents (x, y, z) of its geometry in its own frame, metres; None without geometry.

        A turned desk keeps its size; `box` is the box in the map's frame.
        """
        from semmap.query.entity_shapes import read_size

        return read_size(self.map._seen, self.id)

    @property
    def box(self) -> tuple[float, ...] | None:
        """(x0, y0, z0, x1, y1, z1): its 3D box in the map's frame; None without a placement.

        Without geometry, both corners are its origin.
        """
        from semmap.query.entity_shapes import read_box

        return read_box(self.map._seen, self.id)

    @property
    def __geo_interface__(self) -> dict[str, Any]:
        """A GeoJSON Feature, its coordinates metres in the map's frame."""
        from semmap.query.entity_shapes import feature

        return feature(self._shown())

    def _shown(self) -> dict[str, Any]:
        from semmap.query.entity_shapes import read_shapes

        rows = read_shapes(self.map._seen, [self.id])
        if not rows:
            raise self._gone()
        return rows[0]

    # --- questions and changes

    def is_a(self, type: str) -> bool:
        """Whether it is of a semantic type or of one of its subtypes."""
        row = self.map._rows(
            "SELECT EXISTS (SELECT FROM object WHERE id = %s AND type = %s)", self.id, type
        )
        return bool(row[0][0])

    def describe(self) -> dict[str, Any]:
        """All that the map has of it, as ``semmap show`` prints it."""
        from semmap.query.entity_query import describe_id

        return describe_id(self.map._seen, self.id)

    def history(self, since: datetime | None = None) -> list[EntityVersion]:
        """Where it was, the oldest version first: poses in the map's frame, holders and times.

        Versions that ended before `since` are left out.
        """
        from semmap.query.placements import read_history

        return read_history(self.map._seen, self.id, since)

    def move_to(self, x: float, y: float, z: float, yaw: float | None = None) -> None:
        """Move it, with all that it holds; its holder follows from the geometry.

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
        self.map._write("SELECT move_to(%s, %s, %s, %s, %s)", self.id, x, y, z, yaw)

    def put_on(self, holder: str | MapEntity) -> None:
        """Put it on an object, where it is free near the middle; its orientation is kept.

        ValueError if nothing on it is free.
        """
        self._put(holder, "on")

    def put_in(self, holder: str | MapEntity) -> None:
        """Put it into a room, region or container, free and near the middle; as `put_on`."""
        self._put(holder, "in")

    def delete(self) -> None:
        """Take it out of the map. The entities that it held stay where they are."""
        self.map._write("DELETE FROM entity WHERE id = %s", self.id)

    def _put(self, holder: str | MapEntity, relation: str) -> None:
        above = self.map[holder] if isinstance(holder, str) else holder
        if relation == "on" and above.kind in ("room", "region", "storey"):
            raise ValueError(
                f"{above.name} is a {above.kind}: put {self.name} in it, or on an object"
            )
        if self.kind in FIXED:
            raise ValueError(f"{self.name} is a {self.kind}, which is not put {relation} anything")
        box = self.map._rows(
            "SELECT ST_XMin(box) - pose[1], ST_YMin(box) - pose[2], ST_ZMin(box) - pose[3], "
            "ST_XMax(box) - pose[1], ST_YMax(box) - pose[2], ST_ZMax(box) - pose[3] "
            "FROM world WHERE entity_id = %s",
            self.id,
        )
        if not box:
            raise ValueError(
                f"{self.name} has no placement, so it cannot be put {relation} {above.name}: "
                f"delete it and add it again with a pose, {relation}{'_' * (relation == 'in')} "
                "or a size"
            )
        x0, y0, low, x1, y1, high = box[0]
        with self.map.transaction():
            # Others move the holder before or after this, but not between the choice and the put.
            self.map._write(_LOCK_HOLDERS, above.id, self.id)
            x, y, z = self.map.spot(above, relation, (x1 - x0, y1 - y0, high - low), self.id)
            x, y = x - (x0 + x1) / 2, y - (y0 + y1) / 2
            self.map._write("SELECT move_to(%s, %s, %s, %s)", self.id, x, y, z - low)
            self.map._write("SELECT put(%s, %s, %s)", self.id, above.id, relation)

    def _value(self, column: str) -> Any:
        rows = self.map._rows(f"SELECT name, {column} FROM entity WHERE id = %s", self.id)
        if not rows:
            raise self._gone()
        self._name, value = rows[0]
        return value

    def _set(self, column: str, value: Any) -> None:
        statement = f"UPDATE entity SET {column} = %s WHERE id = %s RETURNING 1"
        if not self.map._write(statement, value, self.id):
            raise RightsError(f"your role may not change the {self.kind} {self.name}")

    def _gone(self) -> LookupError:
        return LookupError(f"{self.name} is no longer in the map {self.map.name}")

    def _other(self, statement: str) -> MapEntity | None:
        """The entity of a statement's first row (id, kind, name); its value is this one's id."""
        rows = self.map._rows(statement, self.id)
        return self.map.entity(*rows[0]) if rows else None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, MapEntity):
            return NotImplemented
        return self.id == other.id and self.map.database is other.map.database

    def __hash__(self) -> int:
        return hash(self.id)

    def __repr__(self) -> str:
        return f"<{self.kind} {self._name}>"

    def _repr_html_(self) -> str:
        """A card: what it is, where it is, and a plan of its room with it."""
        from semmap.api.map_pictures import room_svg

        known = self.describe()
        rows = {
            "type": known["type"],
            "label": known["label"],
            "holder": known["holder"] and f"{known['relation']} {known['holder']}",
            "storey": known["storey"],
            "pose": known["pose"] and ", ".join(f"{v:.3f}" for v in known["pose"][:3]) + " m",
            "joins": "joins" in known and "{place_a} - {place_b}, {state}".format(**known["joins"]),
            "holds": ", ".join(known["holds"][:8]) + (", ..." if len(known["holds"]) > 8 else ""),
            **known["properties"],
        }
        table = "".join(
            f'<tr><th style="text-align:left">{html.escape(str(key))}</th>'
            f'<td style="text-align:left">{html.escape(str(value))}</td></tr>'
            for key, value in rows.items()
            if value not in (None, "", False)
        )
        return (
            '<div style="display:flex;gap:1em;align-items:flex-start"><div>'
            f"<b>{html.escape(known['name'])}</b> ({html.escape(known['kind'])})"
            f"<table>{table}</table></div>{room_svg(self.map, self.id)}</div>"
        )


STATES = ("open", "closed", "locked")


@checked_class
class Door(MapEntity):
    """An entity of the kind ``connector``: it leads from a place to another."""

    @property
    def state(self) -> str:
        """``open``, ``closed`` or ``locked``."""
        return str(self._joins("state"))

    @state.setter
    def state(self, state: str) -> None:
        if state not in STATES:
            raise ValueError(f'{self.name}: state "{state}" is not one of {", ".join(STATES)}')
        self.map._write("UPDATE connector SET state = %s WHERE entity_id = %s", state, self.id)

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
        rows = self.map._rows(
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
        rows = self.map._rows(f"SELECT {column} FROM connector WHERE entity_id = %s", self.id)
        if not rows:
            raise self._gone()
        return rows[0][0]


_LOCK_HOLDERS = """
WITH RECURSIVE up (id) AS (
    SELECT CAST(%s AS bigint)
  UNION
    SELECT p.holder_id FROM up JOIN placement p ON p.entity_id = up.id)
SELECT FROM placement WHERE entity_id = %s OR entity_id IN (SELECT id FROM up)
ORDER BY entity_id FOR UPDATE
"""
