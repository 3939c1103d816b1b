"""Whether two maps are the same: by the public API, judged by Shapely and trimesh."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely
import trimesh
from scipy.spatial import cKDTree

import semmap

TOLERANCE = 1e-6
"""Metres, and radians, within which places and shapes are equal."""

LEAST_HEIGHT = 2e-5
"""Metres that a region has at least once it is drawn."""


GAINED = ("type", "storey", "holder", "relation")
"""What a file may add: the type of a door's form, the storey of a door's rooms, which holds it."""


class Known(NamedTuple):
    """What is compared of an entity."""

    kind: str
    facts: dict[str, Any]
    geometry: shapely.Geometry | None
    box: Any
    pose: semmap.Pose | None
    mesh: trimesh.Trimesh | None


class Picture(NamedTuple):
    """What is compared of a map, read once for several comparisons."""

    entities: dict[str, Known]
    doors: dict[str, Any]

    @classmethod
    def of(cls, place: semmap.Map) -> Picture:
        fronts = dict(place.sql("SELECT name, front FROM entity WHERE map_id = current_map()"))
        return cls({each.name: _known(each, fronts[each.name]) for each in place}, _doors(place))


def _known(one: semmap.MapEntity, front: float) -> Known:
    facts = {
        "kind": one.kind,
        "type": one.type,
        "label": one.label,
        "properties": one.properties,
        "storey": one.storey and one.storey.name,
        "room": one.room and one.room.name,
        "holder": one.holder and one.holder.name,
        "relation": one.relation,
        "front": round(front, 9),
    }
    mesh = one.mesh if one.kind == "object" else None
    return Known(one.kind, facts, one.geometry, one.box, one.pose, mesh)


def differences(old: semmap.Map | Picture, new: semmap.Map, meshes: bool = True) -> list[str]:
    """A sentence for each difference; of meshes, where the format has them."""
    old = old if isinstance(old, Picture) else Picture.of(old)
    before, (after, doors) = old.entities, Picture.of(new)
    if before.keys() != after.keys():
        return [f"lost {before.keys() - after.keys()}, gained {after.keys() - before.keys()}"]
    found = []
    for name, one in before.items():
        other = after[name]
        found += [
            f"{name}: {key} is {other.facts[key]!r}, was {value!r}"
            for key, value in one.facts.items()
            if other.facts[key] != value and not (key in GAINED and value is None)
        ]
        found += [f"{name}: {each}" for each in _moved(one, other)]
        if meshes and not _same_mesh(one.mesh, other.mesh):
            found.append(f"{name}: another mesh")
    found += [
        f"{name}: {doors.get(name)}, was {was}"
        for name, was in old.doors.items()
        if doors.get(name) != was
    ]
    return found


def _doors(place: semmap.Map) -> dict[str, Any]:
    return {
        row[0]: [round(v, 6) if isinstance(v, float) else v for v in row[1:]]
        for row in place.sql(
            "SELECT e.name, a.name, b.name, c.form, c.state, c.direction, c.behaviour, c.width, "
            "c.height, c.step, c.permissions FROM connector c JOIN entity e ON e.id = c.entity_id "
            "JOIN entity a ON a.id = c.place_a LEFT JOIN entity b ON b.id = c.place_b "
            "WHERE e.map_id = current_map()"
        )
    } | {
        row[0]: [round(v, 6) if isinstance(v, float) else v for v in row[1:]]
        for row in place.sql(
            "SELECT e.name, s.elevation, s.height FROM storey s JOIN entity e "
            "ON e.id = s.entity_id WHERE e.map_id = current_map()"
        )
    }


def _moved(one: Known, other: Known) -> list[str]:
    """What is elsewhere, or of another shape."""
    first, second = one.geometry, other.geometry
    if first is None or second is None:
        return [] if first is second or one.kind == "storey" else ["geometry is lost or gained"]
    if one.kind == "storey" and first.area == 0:
        return []
    found = []
    if first.area > 0 and shapely.symmetric_difference(first, second).area > TOLERANCE:
        found.append(f"another footprint, {second.wkt[:80]}, was {first.wkt[:80]}")
    if first.area == 0 and min(first.hausdorff_distance(g) for g in (second, second.reverse())) > (
        TOLERANCE
    ):
        found.append(f"is at {second.wkt}, was at {first.wkt}")
    if one.kind == "connector":  # an import gives each door its leaf
        boxes = [each.box[2:3] for each in (one, other) if each.box]
    elif one.kind in ("room", "elevator", "storey"):
        boxes = [each.box[2::3] for each in (one, other) if each.box]
    else:
        boxes = [each.box for each in (one, other)]
    if one.kind != "elevator" and not np.allclose(*boxes, atol=LEAST_HEIGHT, rtol=0):
        found.append(f"box {boxes[1]}, was {boxes[0]}")
    if one.kind in ("object", "agent", "connector") and one.pose is not None:
        assert other.pose is not None  # it has a geometry
        pose = one.pose.inverse() @ other.pose
        if max(map(abs, pose[:6])) > TOLERANCE:
            found.append(f"pose {other.pose}, was {one.pose}")
    return found


def _same_mesh(one: trimesh.Trimesh | None, other: trimesh.Trimesh | None) -> bool:
    """Whether two meshes have the same triangles: of each a centre near one of the other."""
    if one is None or other is None:
        return one is other
    if not np.isclose(one.area, other.area, rtol=1e-6):
        return False
    if len(one.faces) != len(other.faces):  # prisms may be cut otherwise
        return bool(np.isclose(one.volume, other.volume, rtol=1e-6))
    away, _ = cKDTree(one.triangles_center).query(other.triangles_center)
    return bool(away.max() < TOLERANCE) or bool(np.isclose(one.volume, other.volume, rtol=1e-6))
