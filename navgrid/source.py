"""The current map, read from the database: the one module here that does so."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from sqlalchemy import Connection, text

from navgrid.scene import NO_TRIANGLES, Bounds, Place, Scene, Thing
from semmap.draw.view import StoreyView
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.query.maps import current_name
from semmap.query.meshes import models_triangles
from semmap.query.storeys import read_storeys, supertypes

__all__ = ["read_scene", "read_storey_names", "read_things", "read_wanted_storeys"]

BELOW, TOP = 0.5, 3.0
"""Metres below a storey's floor, and above the highest one's, of what belongs to its grid."""

LEAF = (0.05, 2.1)
"""Thickness and height, metres, of a shut door of which no mesh is known."""

_STOREYS = """
SELECT e.name, s.elevation, s.entity_id FROM storey s JOIN entity e ON e.id = s.entity_id
WHERE e.map_id = current_map() ORDER BY s.elevation, e.id
"""

_THINGS = """
WITH RECURSIVE carried (id) AS (
    SELECT p.entity_id FROM placement p JOIN entity a ON a.id = p.holder_id AND a.kind = 'agent'
    WHERE a.map_id = current_map()
    UNION SELECT p.entity_id FROM carried c JOIN placement p ON p.holder_id = c.id
)
SELECT e.id, e.name, e.kind, e.type, e.properties, w.pose, c.state, c.width, c.pose_a, c.pose_b,
       r.floor, lower(g.valid) AS since, upper(g.valid) AS until,
       CASE WHEN e.kind IN ('room', 'region') THEN ST_AsBinary(w.footprint) END AS footprint,
       (SELECT array_agg(em.model_id ORDER BY em.model_id) FROM entity_model em
        JOIN model m ON m.id = em.model_id
        WHERE em.entity_id = e.id AND m.triangles > 0 AND e.kind IN ('room', 'object', 'connector')
          AND NOT (e.kind = 'room' AND m.kind = 'polygon')
          AND (em.role = 'visual' OR NOT EXISTS (SELECT FROM entity_model v
               WHERE v.entity_id = e.id AND v.role = 'visual'))) AS models
FROM world w JOIN entity e ON e.id = w.entity_id
     LEFT JOIN connector c ON c.entity_id = e.id LEFT JOIN room r ON r.entity_id = e.id
     LEFT JOIN region g ON g.entity_id = e.id
WHERE e.map_id = current_map() AND e.kind IN ('room', 'object', 'region', 'connector', 'agent')
      AND e.id NOT IN (SELECT id FROM carried)
"""

_ON_STOREY = """
  AND CASE WHEN e.kind IN ('room', 'region') AND CAST(:storey AS bigint) IS NOT NULL
      THEN coalesce(w.storey_id = :storey, ST_ZMin(w.box) < :high AND ST_ZMax(w.box) >= :low)
      ELSE ST_ZMin(w.box) < :high AND ST_ZMax(w.box) >= :low END
"""

_IN_BOUNDS = "  AND w.box && ST_MakeEnvelope(:x0, :y0, :x1, :y1)\n"


def read_storey_names(connection: Connection) -> list[str]:
    """The names of the current map's storeys, the lowest first; of a map without, the map's own."""
    names = [row.name for row in connection.execute(text(_STOREYS))]
    if names:
        return names
    return [current_name(connection)]


def read_scene(
    connection: Connection,
    storey: str,
    *,
    bounds: Bounds | None = None,
    rooms: Sequence[str] | None = None,
    margin: float = 0.0,
    moment: datetime | None = None,
) -> Scene:
    """What stands on a storey, or in a part of it, at a moment (regions that hold then).

    What an agent carries is a part of it, and left out.

    Parameters
    ----------
    bounds : only what is in or near these, on the ground
    rooms : only these rooms, their doorways and what is in or near them
    margin : metres around bounds or rooms of which things are read, too

    Raises
    ------
    LookupError
        There is no such storey, or it has no such room.
    """
    low, high, elevation, storey_id = _band(connection, storey)
    values: dict[str, Any] = {"storey": storey_id, "low": low, "high": high}
    inside = bounds
    if rooms is not None:
        inside = _bounds_of_rooms(connection, rooms, values, bounds)
    where = _ON_STOREY
    if inside is not None:
        x0, y0, x1, y1 = inside
        values |= {"x0": x0 - margin, "y0": y0 - margin, "x1": x1 + margin, "y1": y1 + margin}
        where += _IN_BOUNDS
    rows = connection.execute(text(_THINGS + where + "ORDER BY e.id"), values).all()
    things = [t for t in _things(connection, rows) if t.holds_at(moment)]
    return Scene(storey, elevation, tuple(things), tuple(_places(rows, rooms)), (low, high))


def read_things(
    connection: Connection,
    ids: Iterable[int],
    *,
    kind: str | None = None,
    storey: str | None = None,
    moment: datetime | None = None,
) -> list[Thing]:
    """The entities of these ids that are placed in the current map, as `read_scene` gives them.

    Parameters
    ----------
    kind : only things of that kind
    storey : only what stands there
    moment : only regions that hold then
    """
    values: dict[str, Any] = {"ids": [*ids], "kind": kind}
    where = "  AND e.id = ANY(:ids) AND (CAST(:kind AS text) IS NULL OR e.kind = :kind) "
    if storey is not None:
        low, high, _, storey_id = _band(connection, storey)
        values |= {"storey": storey_id, "low": low, "high": high}
        where += _ON_STOREY
    rows = connection.execute(text(_THINGS + where + "ORDER BY e.id"), values).all()
    return [t for t in _things(connection, rows) if t.holds_at(moment)]


def read_wanted_storeys(connection: Connection, name: str | None = None) -> list[StoreyView]:
    """The storeys of the current map, the lowest first; only that of a name where it is given.

    Raises
    ------
    LookupError
        There is no storey of that name; the message names those that there are.
    """
    storeys = read_storeys(connection)
    if name is None:
        return storeys
    wanted = [s for s in storeys if s.name == name]
    if not wanted:
        raise LookupError(_no_such("storey", name, [s.name for s in storeys]))
    return wanted


def _band(connection: Connection, storey: str) -> tuple[float, float, float, int | None]:
    """Lowest and highest z of what belongs to a storey's grid, its elevation and its id."""
    rows = connection.execute(text(_STOREYS)).all()
    if not rows:
        names = read_storey_names(connection)
        if storey not in names:
            raise LookupError(_no_such("storey", storey, names))
        floor = connection.execute(
            text(
                "SELECT coalesce(min(w.pose[3] + r.floor), 0) FROM entity e "
                "JOIN room r ON r.entity_id = e.id JOIN world w ON w.entity_id = e.id "
                "WHERE e.map_id = current_map() AND e.kind = 'room'"
            )
        ).scalar_one()
        return floor - BELOW, floor + TOP, floor, None
    names = [row.name for row in rows]
    if storey not in names:
        raise LookupError(_no_such("storey", storey, names))
    at = names.index(storey)
    elevation = rows[at].elevation
    above = [row.elevation for row in rows if row.elevation > elevation]
    return elevation - BELOW, min(above, default=elevation + TOP), elevation, rows[at].entity_id


def _bounds_of_rooms(
    connection: Connection, rooms: Sequence[str], values: dict[str, Any], bounds: Bounds | None
) -> Bounds:
    found = connection.execute(
        text(
            "SELECT e.name, ST_XMin(w.box) AS x0, ST_YMin(w.box) AS y0, ST_XMax(w.box) AS x1, "
            "ST_YMax(w.box) AS y1 FROM world w JOIN entity e ON e.id = w.entity_id "
            "WHERE e.map_id = current_map() AND e.kind = 'room'" + _ON_STOREY
        ),
        values,
    ).all()
    known = {row.name: tuple(row)[1:] for row in found}
    for room in rooms:
        if room not in known:
            raise LookupError(_no_such("room", room, [*known]))
    boxes = np.array([known[room] for room in rooms])
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    if bounds is not None:
        low, high = np.maximum(low, bounds[:2]), np.minimum(high, bounds[2:])
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _no_such(what: str, name: str, names: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, names, n=1)
    mend = f"did you mean {near[0]}?" if near else f"there are: {', '.join(names) or 'none'}"
    return f"there is no {what} named {name}; {mend}"


def _things(connection: Connection, rows: Sequence[Any]) -> list[Thing]:
    types = supertypes(connection, {row.type or row.kind for row in rows})
    driver = connection.connection.driver_connection
    assert driver is not None
    models = models_triangles(driver, {m for row in rows for m in row.models or ()})
    things = []
    for row in rows:
        pose = Pose(*row.pose)
        parts = [_placed(models[m], pose) for m in row.models or () if m in models]
        triangles = np.concatenate(parts) if parts else NO_TRIANGLES
        if row.kind == "connector" and not parts:
            triangles = _leaf(row)
        things.append(
            Thing(
                row.id,
                row.name,
                row.kind,
                types.get(row.type or row.kind, (row.kind,)),
                triangles,
                None if row.footprint is None else shapely.from_wkb(bytes(row.footprint)),
                row.properties,
                row.state,
                (row.since, row.until),
            )
        )
    return things


def _placed(triangles: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    """Triangles in the map's frame; equal corners stay equal to the last bit."""
    r, t = pose.rotation, (pose.x, pose.y, pose.z)
    if (pose.qx, pose.qy, pose.qz) == (0.0, 0.0, 0.0):
        return np.add(triangles, t, dtype=np.float64)
    x, y, z = np.moveaxis(triangles, 2, 0)
    found = np.empty_like(triangles)
    for k in range(3):
        found[..., k] = x * r[k, 0] + y * r[k, 1] + z * r[k, 2] + t[k]
    return found


def _leaf(row: Any) -> NDArray[np.float64]:
    """A shut door of which no mesh is known, as the box of its opening."""
    frame = Pose(*row.pose)
    a, b = (frame @ Pose(*pose) for pose in (row.pose_a, row.pose_b))
    thick, high = LEAF
    half = (row.width or 0.9) / 2
    heading = np.arctan2(b.y - a.y, b.x - a.x) if (a.x, a.y) != (b.x, b.y) else frame.yaw
    middle = Pose.planar((a.x + b.x) / 2, (a.y + b.y) / 2, float(heading), min(a.z, b.z))
    box = box_mesh((-thick / 2, -half, 0.0), (thick / 2, half, high))
    return _placed(box.triangles, middle)


def _places(rows: Sequence[Any], rooms: Sequence[str] | None) -> list[Place]:
    """Rooms, and the floor between the poses before and behind each connector."""
    places = []
    for row in rows:
        if (
            row.kind == "room"
            and row.footprint is not None
            and (rooms is None or row.name in rooms)
        ):
            floor = row.pose[2] + row.floor
            places.append(Place(row.name, shapely.from_wkb(bytes(row.footprint)), floor))
    inside = shapely.union_all([p.outline for p in places]).buffer(0.5)
    for row in rows:
        if row.kind != "connector":
            continue
        a, b = (Pose(*row.pose) @ Pose(*pose) for pose in (row.pose_a, row.pose_b))
        if (a.x, a.y) != (b.x, b.y):
            line = shapely.LineString([(a.x, a.y), (b.x, b.y)])
            if rooms is None or inside.intersects(line):
                area = line.buffer((row.width or 0.9) / 2, cap_style="flat")
                places.append(Place(row.name, area, min(a.z, b.z)))
    return places
