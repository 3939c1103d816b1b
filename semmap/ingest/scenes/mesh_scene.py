"""A mesh file with named nodes (GLB, glTF, COLLADA, OBJ) as a scene."""

from __future__ import annotations

from pathlib import Path

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.ingest.meshes.mesh_file import mesh_parts
from semmap.ingest.meshes.mesh_size import MeshFileError
from semmap.ingest.scenes.scene_nodes import SceneNode, scene_world
from semmap.ingest.world import World, WorldError


def read_mesh_scene(path: Path, *, scale: float = 1.0) -> World:
    """Return an object for each node with a mesh; its frame is below the middle of its box.

    `scale` is metres per unit of a format without units. A WorldError refuses a file that cannot be
    used.
    """
    by_node: dict[str, list[Mesh]] = {}
    try:
        for names, mesh in mesh_parts(path):
            if len(mesh.faces):
                name = names[0] if names else path.stem
                by_node.setdefault(name, []).append(Mesh(scale * mesh.vertices, mesh.faces))
    except MeshFileError as error:
        raise WorldError(path, "mesh", error.problem, error.fix) from error
    return scene_world(path, [_node(name, meshes) for name, meshes in by_node.items()])


def _node(name: str, meshes: list[Mesh]) -> SceneNode:
    low = [min(float(m.vertices[:, k].min()) for m in meshes) for k in range(3)]
    high = [max(float(m.vertices[:, k].max()) for m in meshes) for k in range(3)]
    x, y = ((low[k] + high[k]) / 2 for k in range(2))
    return SceneNode(name, Pose(x, y, low[2]), meshes)
