"""A map's storeys with rooms, objects, doors and regions: arrays and plain dataclasses.

What pictures and grids are made of. Where a map has no storeys, it is one; what no storey holds
belongs to the highest one whose floor is not above it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from sqlalchemy import Connection, text

from semmap.draw.view import DoorView, ObjectView, RegionView, RoomView, StoreyView
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.query.maps import current_name
from semmap.query.meshes import world_triangles

__all__ = ["read_storeys", "supertypes"]

BLOCKED = {"blocked_region", "keepout_zone"}
"""Regions of these types, or with the property ``blocked: true``, are closed to robots."""

_DEFAULT_HEIGHT = 2.5
_SLACK = 0.5  # metres by which a thing may stand below the floor that it belongs to

_ENTITIES = """
SELECT e.id, e.name, e.kind, e.type, e.label, e.properties, w.storey_id, w.pose,
       ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high, ST_AsBinary(w.footprint) AS footprint,
       r.floor, r.ceiling, c.form, c.state, c.width, c.pose_a, c.pose_b,
       s.elevation, s.height
FROM entity e LEFT JOIN world w ON w.entity_id = e.id
     LEFT JOIN room r ON r.entity_id = e.id LEFT JOIN connector c ON c.entity_id = e.id
     LEFT JOIN storey s ON s.entity_id = e.id
WHERE e.map_id = current_map() ORDER BY e.id
"""


def read_storeys(connection: Connection, *, meshes: bool = True) -> list[StoreyView]:
    """The storeys of the current map, the lowest first.

    Parameters
    ----------
    meshes : read the triangles of objects and doors, too

    Raises
    ------
    LookupError
        There is no map, or it is empty.
    """
    rows = connection.execute(text(_ENTITIES)).all()
    if not rows:
        raise LookupError("the map is empty: semmap import FILE fills it")
    types = supertypes(connection, {row.type for row in rows if row.type} | {r.kind for r in rows})
    shaped = [r.id for r in rows if r.kind in ("object", "connector")] if meshes else []
    triangles = world_triangles(connection, shaped)
    storeys = {row.id: StoreyView(row.name, row.elevation) for row in rows if row.kind == "storey"}
    ordered = sorted(storeys.values(), key=lambda s: s.elevation)
    if not ordered:
        ordered = [StoreyView(current_name(connection), _ground(rows))]
    for row in rows:
        if row.pose is None or row.kind in ("storey", "elevator"):
            continue
        storey = storeys.get(row.storey_id) or _by_height(ordered, row)
        _add(storey, row, types.get(row.type or row.kind, ()), triangles.get(row.id))
    return ordered


def supertypes(connection: Connection, names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Each type with what subsumes it: itself first, then by how much they subsume."""
    rows = connection.execute(
        text(
            "SELECT c.sub, c.super FROM type_closure c WHERE c.sub = ANY(:names) ORDER BY c.sub, "
            "c.sub <> c.super, (SELECT count(*) FROM type_closure o WHERE o.super = c.super), 2"
        ),
        {"names": sorted(names)},
    )
    found: dict[str, tuple[str, ...]] = {}
    for sub, above in rows:
        found[sub] = (*found.get(sub, ()), above)
    return found


def _ground(rows: Iterable[Any]) -> float:
    """The floor of a map without storeys: that of its lowest room, else the map's origin."""
    return min((r.pose[2] + r.floor for r in rows if r.kind == "room" and r.pose), default=0.0)


def _by_height(ordered: list[StoreyView], row: Any) -> StoreyView:
    low = row.low if row.low is not None else row.pose[2]
    below = [s for s in ordered if s.elevation <= low + _SLACK]
    return below[-1] if below else ordered[0]


def _add(
    storey: StoreyView, row: Any, types: tuple[str, ...], triangles: NDArray[np.float64] | None
) -> None:
    outline = None if row.footprint is None else shapely.from_wkb(row.footprint)
    mesh = None if triangles is None or not len(triangles) else _mesh(triangles)
    match row.kind:
        case "room" if outline is not None:
            low = row.pose[2] + row.floor
            ceiling = row.ceiling if row.ceiling is not None else row.floor + _DEFAULT_HEIGHT
            storey.rooms.append(
                RoomView(row.name, outline, low, row.pose[2] + ceiling, types, row.label)
            )
        case "object" | "agent":
            storey.objects.append(ObjectView(row.name, types, mesh, outline))
        case "region" if outline is not None:
            blocked = bool(BLOCKED & set(types)) or row.properties.get("blocked") is True
            storey.regions.append(RegionView(row.name, outline, types, blocked))
        case "connector":
            frame = Pose(*row.pose)
            poses = (frame @ Pose(*row.pose_a), frame @ Pose(*row.pose_b))
            storey.doors.append(
                DoorView(row.name, poses, row.width, row.form, row.state, outline, mesh)
            )


def _mesh(triangles: NDArray[np.float64]) -> Mesh:
    faces = np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3)
    return Mesh(triangles.reshape(-1, 3), faces)
