"""A map as a glTF 2.0 scene: storeys hold rooms, rooms hold objects, and so on, as nodes.

Nodes have the names of entities, and kind, type, label and properties as `extras`. Rooms are level
faces at their floors. glTF is y-up: the root turns the map's z up.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from semmap.export.features import MapFeature, MapFeatures
from semmap.geometry.mesh import Mesh, prism_mesh
from semmap.geometry.pose import IDENTITY
from semmap.geometry.tin import to_mesh

ROOT, FRAME = "scene", "map"
"""The nodes above those of entities: the scene, y up, and the map's frame in it."""

Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])

SURFACES: dict[str, dict[str, Any]] = {
    "room": {"baseColorFactor": (0.80, 0.80, 0.76, 1.0)},
    "region": {"baseColorFactor": (0.85, 0.65, 0.25, 0.4), "alphaMode": "BLEND"},
    "object": {"baseColorFactor": (0.62, 0.66, 0.70, 1.0)},
    "agent": {"baseColorFactor": (0.30, 0.45, 0.75, 1.0)},
}
"""The material of each kind that has a surface."""


def write_gltf(found: MapFeatures, path: Path) -> None:
    """Write a map as ``.glb``, or ``.gltf`` with its buffers in itself."""
    scene: Any = trimesh.Scene(base_frame=ROOT)
    features = {each.name: each for each in found.all()}
    nodes = {name: f"{name}_" if name in (ROOT, FRAME) else name for name in features}
    scene.graph.update(FRAME, ROOT, matrix=Y_UP, metadata={"map": found.name})
    for name, each in features.items():
        above = features.get(each.holder or "")
        outer = IDENTITY if above is None or above.pose is None else above.pose
        matrix = np.eye(4) if each.pose is None else (outer.inverse() @ each.pose).matrix
        geometry = _geometry(scene, found, each, nodes[name])
        scene.graph.update(
            nodes[name],
            FRAME if above is None else nodes[above.name],
            matrix=matrix,
            metadata={k: v for k, v in _extras(each).items() if v},
            **({} if geometry is None else {"geometry": geometry}),
        )
    if not scene.geometry:
        raise ValueError(f"nothing in the map {found.name} has a surface, and a scene has meshes")
    if path.suffix.lower() == ".glb":
        path.write_bytes(scene.export(file_type="glb"))
        return
    gltf: Any = trimesh.exchange.gltf
    made = gltf.export_gltf(scene, embed_buffers=True)
    path.write_bytes(made["model.gltf"])


def _extras(each: MapFeature) -> dict[str, Any]:
    return {**{k: each.keys.get(k) for k in ("kind", "type", "label")}, "properties": each.free}


def _geometry(scene: Any, found: MapFeatures, each: MapFeature, node: str) -> str | None:
    """Add the mesh of an entity, which others may share; return its name."""
    kind = each.keys["kind"]
    if "mesh" in each.keys:
        mesh, name = found.meshes[each.keys["mesh"]], f"{Path(each.keys['mesh']).stem} {kind}"
        if not len(mesh.faces):
            return None
    elif kind in ("room", "region") and each.geometry is not None and each.geometry.area > 0:
        mesh, name = _level(each, found.floor_of(each)), node
    else:
        return None
    if name not in scene.geometry:
        visual: Any = trimesh.visual
        material = visual.material.PBRMaterial(name=kind, **SURFACES[kind])
        scene.geometry[name] = trimesh.Trimesh(
            mesh.vertices,
            mesh.faces,
            process=False,
            visual=visual.TextureVisuals(material=material),
        )
    return name


def _level(each: MapFeature, z: float) -> Mesh:
    """The level face of a room or region, in its own frame: the lower side of its prism, up."""
    prism = prism_mesh(each.geometry, z, z + 1.0).triangles
    level = to_mesh(prism[(prism[:, :, 2] < z + 0.5).all(axis=1)][:, ::-1])
    return level.moved((each.pose or IDENTITY).inverse())
