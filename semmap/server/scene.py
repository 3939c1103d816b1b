"""What the viewer draws of a map: entities as JSON, and their meshes, each once, as GLB."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
import trimesh

from semmap.api.map import Map
from semmap.draw.palette import STATES, object_colour, room_colour
from semmap.export.features import MapFeature, MapFeatures, read_map, read_meshes

CLOUD = 100_000
"""The most points of a cloud that are sent: a page draws millions slowly."""


def scene_of(map: Map) -> dict[str, Any]:
    """The entities of a map, with the cursor of the events that follow; metres, the map's frame.

    A pose is seven numbers, x, y, z and the quaternion (x, y, z, w) of an entity's frame, in which
    its mesh is: the `mesh`-th of `meshes_of`.
    """
    with map.transaction(), map.snapshot() as seen:
        ((cursor,),) = map.execute("SELECT change_cursor()")
        types = dict(map.execute("SELECT sub, array_agg(super) FROM type_closure GROUP BY sub"))
        found = read_map(seen, folder=_FOLDER, boxes=True)
    number = {name: index for index, name in enumerate(found.meshes)}
    storeys = [
        {"name": each.name, "elevation": each.keys.get("elevation", 0.0)}
        for each in found.all("storeys")
    ]
    return {
        "map": map.name,
        "cursor": cursor,
        "states": STATES,
        "storeys": sorted(storeys, key=lambda each: each["elevation"]),
        "places": [_place(found, each, types) for each in found.all("rooms", "regions")],
        "doors": [_door(found, each) for each in found.all("doors") if each.geometry is not None],
        "things": [
            _about(each)
            | {
                "pose": None if each.pose is None else list(each.pose),
                "mesh": number.get(each.keys.get("mesh", "")),
                "colour": object_colour(types.get(each.keys.get("type"), ())),
                "overhead": each.keys["kind"] == "object" and _covers(types, each),
            }
            for each in found.all("objects")
        ],
    }


def meshes_of(map: Map) -> bytes:
    """The meshes of a map as GLB, z up, each a node with its number; clouds are points."""
    with map.snapshot() as seen:
        found = MapFeatures(map.name)
        read_meshes(seen, found, _FOLDER, True)
    scene: Any = trimesh.Scene()
    for number, mesh in enumerate(found.meshes.values()):
        points: Any = trimesh.PointCloud
        made = (
            trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            if len(mesh.faces)
            else points(mesh.vertices[:: max(1, len(mesh.vertices) // CLOUD)])
        )
        scene.add_geometry(made, node_name=str(number), geom_name=str(number))
    if not scene.geometry:
        scene.add_geometry(trimesh.Trimesh(np.eye(3), [[0, 1, 2]]), node_name="none")
    return bytes(scene.export(file_type="glb"))


def boxes_of(map: Map) -> dict[str, list[float]]:
    """The boxes of entities in their own frames: low x, y, z, then high ones, metres."""
    return {name: box for name, *box in map.execute(_BOXES)}


_BOXES = (
    "SELECT e.name, ST_XMin(b), ST_YMin(b), ST_ZMin(b), ST_XMax(b), ST_YMax(b), ST_ZMax(b) "
    "FROM (SELECT em.entity_id, ST_3DExtent(m.hull) AS b FROM entity_model em "
    "JOIN model m ON m.id = em.model_id GROUP BY 1) t JOIN entity e ON e.id = t.entity_id "
    "WHERE e.map_id = current_map() AND b IS NOT NULL"
)

_FOLDER = "meshes"
_COVERS = {"ceiling", "roof"}


def _covers(types: dict[str, list[str]], each: MapFeature) -> bool:
    """Whether it hides what is below it from a view from above."""
    return not _COVERS.isdisjoint(types.get(each.keys.get("type", ""), ()))


def _about(each: MapFeature) -> dict[str, Any]:
    keys = ("name", "kind", "type", "label", "storey")
    return {key: each.keys.get(key) for key in keys} | {"holder": each.holder}


def _place(found: MapFeatures, each: MapFeature, types: dict[str, list[str]]) -> dict[str, Any]:
    shape = each.geometry
    parts = [] if shape is None else shapely.get_parts(shape).tolist()
    areas = [part for part in parts if part.geom_type == "Polygon"]
    floor, ceiling = each.keys.get("floor", 0.0), each.keys.get("ceiling")
    base = found.floor_of(each)
    return _about(each) | {
        "areas": [
            [np.round(ring.coords, 4)[:, :2].tolist() for ring in (a.exterior, *a.interiors)]
            for a in areas
        ],
        "floor": base,
        "ceiling": None if ceiling is None else base + ceiling - floor,
        "colour": room_colour(types.get(each.keys.get("type", ""), ()), each.name),
    }


def _door(found: MapFeatures, each: MapFeature) -> dict[str, Any]:
    assert each.geometry is not None
    keys = ("state", "width", "height", "direction")
    return (
        _about(each)
        | {key: each.keys.get(key) for key in keys}
        | {
            "joins": each.places,
            "line": np.round(shapely.get_coordinates(each.geometry), 4).tolist(),
            "floor": found.floor_of(each),
        }
    )
