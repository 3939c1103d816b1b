"""MuJoCo scenes (MJCF), compiled by MuJoCo, in the pose in which its simulation begins."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.ingest.scenes.mjcf_size import check_size
from semmap.ingest.scenes.scene_nodes import SceneJoint, SceneNode, scene_world
from semmap.ingest.scenes.solids import solid
from semmap.ingest.sdf.elements import Unusable, leaving_out
from semmap.ingest.sdf.models import Role
from semmap.ingest.world import Skipped, World, WorldError
from semmap.ingest.xml_file import read_xml

WORLD = 0
"""The body of the world itself: its geoms are objects, each of its own."""


def read_mjcf(path: Path, *, geometry: Role = "visual") -> World:
    """Return the world of an MJCF file: an object for each body that has geoms.

    An object has the pose of its body; the nearest body above it that has geoms holds it. Geoms of
    the world itself are objects: floors, walls. Of a body with geoms that collide and others that
    do not, the latter are the visual ones. Needs the extra `semmap[manipulation]`.

    Raises
    ------
    WorldError
        The file is not MJCF, MuJoCo cannot compile it, or it has more than the limits allow.
    """
    root = read_xml(path, ("mujoco",))
    check_size(root, path)
    try:
        import mujoco
    except ImportError as error:
        fix = "Install the extra: pip install 'semmap[manipulation]'."
        raise WorldError(path, "file", f"needs {error.name}", fix) from error
    warnings: list[str] = []  # else MuJoCo writes them into a file beside the user's
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(warnings.append)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
    except Exception as error:  # of what cannot be compiled, MuJoCo raises several kinds
        problem = f"MuJoCo cannot compile it ({' '.join(str(error).split())[:300]})"
        fix = "Correct it, or put the files that it names where it says."
        raise WorldError(path, "model", problem, fix) from error
    finally:
        mujoco.set_mju_user_warning(before)
    places = (data.xpos, data.xmat, data.geom_xpos, data.geom_xmat)
    if not all(np.isfinite(place).all() for place in places):
        raise WorldError(path, "model", "places a body at infinity", "Correct its pose.")
    skipped: list[Skipped] = []
    bodies: dict[int, SceneNode] = {}
    nodes = []
    for body in range(1, model.nbody):  # parents before their children
        pose = _pose(data.xpos[body], data.xmat[body])
        name = model.body(body).name or f"body{body}"
        bodies[body] = SceneNode(name, pose, [], bodies.get(int(model.body_parentid[body])))
        bodies[body].joint = _joint(mujoco, model, body)
        nodes.append(bodies[body])
    for geom in _shown(model, geometry):
        where = f"geom {model.geom(geom).name or geom}"
        with leaving_out(skipped):
            mesh = _surface(mujoco, model, geom, where)
            placed = mesh.moved(_pose(data.geom_xpos[geom], data.geom_xmat[geom]))
            body = int(model.geom_bodyid[geom])
            if body == WORLD:
                nodes.append(_world_geom(mujoco, model, data, geom, placed))
            else:
                bodies[body].meshes.append(placed)
    name = str(model.names[: model.names.index(b"\0")].decode())
    world = scene_world(path, nodes, name, skipped)
    world.notes += [f"MuJoCo warns: {' '.join(text.split())}" for text in warnings]
    return world


def _joint(mujoco: Any, model: Any, body: int) -> SceneJoint | None:
    """Return how a body moves; None where it has no joint."""
    count, first = int(model.body_jntnum[body]), int(model.body_jntadr[body])
    if not count:
        return None
    kinds = {mujoco.mjtJoint.mjJNT_SLIDE: "prismatic", mujoco.mjtJoint.mjJNT_HINGE: "continuous"}
    kind = kinds.get(mujoco.mjtJoint(int(model.jnt_type[first])), "floating")
    lower = upper = None
    if model.jnt_limited[first] and kind != "floating":
        kind = "revolute" if kind == "continuous" else kind
        zero = float(model.qpos0[model.jnt_qposadr[first]])
        lower, upper = (float(end) - zero for end in model.jnt_range[first])
    x, y, z = model.jnt_pos[first].tolist()
    dx, dy, dz = model.jnt_axis[first].tolist()
    kind = kind if count == 1 else "several"
    return SceneJoint(kind, (x, y, z), (dx, dy, dz), lower, upper)


def _shown(model: Any, geometry: Role) -> Iterator[int]:
    """Yield the geoms of a role; all those of a body that has only one role.

    What collides is visual, too, where it is in a group of the body that has visual geoms: models
    with twin shapes have those for collisions in a group of their own, which is not drawn.
    """
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    groups = list(zip(model.geom_bodyid.tolist(), model.geom_group.tolist(), strict=True))
    drawn = {groups[geom] for geom in np.flatnonzero(~collides)}
    visual = ~collides | np.array([group in drawn for group in groups], np.bool_)
    wanted = collides if geometry == "collision" else visual
    have_role = {*model.geom_bodyid[wanted].tolist()} - {WORLD}
    for geom, body in enumerate(model.geom_bodyid.tolist()):
        if wanted[geom] or body not in have_role:
            yield geom


def _surface(mujoco: Any, model: Any, geom: int, where: str) -> Mesh:
    """Return the surface of a geom in its own frame."""
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    size = model.geom_size[geom].tolist()
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        return _height_field(model, int(model.geom_dataid[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        if not (size[0] and size[1]):
            fix = "Give the plane a size, or draw the rooms."
            raise Unusable(where, "is a plane without end, which has no surface", fix)
        return solid("plane", where, size=(2 * size[0], 2 * size[1]))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return solid("box", where, size=[2 * side for side in size])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return solid("sphere", where, radius=size[0])
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return solid("ellipsoid", where, radii=size)
    if kind in (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_CAPSULE):
        tag = "cylinder" if kind == mujoco.mjtGeom.mjGEOM_CYLINDER else "capsule"
        return solid(tag, where, radius=size[0], length=2 * size[1])
    raise Unusable(where, f"has the type {kind.name}, which has no surface", "Take a mesh.")


def _mesh(model: Any, number: int) -> Mesh:
    first, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
    begin, faces = int(model.mesh_faceadr[number]), int(model.mesh_facenum[number])
    vertices = np.array(model.mesh_vert[first : first + count], np.float64)
    return Mesh(vertices, np.array(model.mesh_face[begin : begin + faces], np.int32))


def _height_field(model: Any, number: int) -> Mesh:
    """Return the upper surface of a height field."""
    rows, columns = int(model.hfield_nrow[number]), int(model.hfield_ncol[number])
    x, y, top, _ = model.hfield_size[number].tolist()
    first = int(model.hfield_adr[number])
    heights = top * np.array(model.hfield_data[first : first + rows * columns], np.float64)
    ys, xs = np.meshgrid(np.linspace(-y, y, rows), np.linspace(-x, x, columns), indexing="ij")
    corners = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]
    faces = np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in ((a, b, c), (a, c, d))])
    return Mesh(np.column_stack([xs.ravel(), ys.ravel(), heights]), faces.astype(np.int32))


def _world_geom(mujoco: Any, model: Any, data: Any, geom: int, placed: Mesh) -> SceneNode:
    """Return a geom of the world as a node; MuJoCo moves a mesh's frame, which is undone here."""
    pose, name = _pose(data.geom_xpos[geom], data.geom_xmat[geom]), model.geom(geom).name
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        name = name or model.mesh(mesh).name
        (x, y, z), (qw, qx, qy, qz) = model.mesh_pos[mesh].tolist(), model.mesh_quat[mesh].tolist()
        pose = pose @ Pose(x, y, z, qx, qy, qz, qw).inverse()
    return SceneNode(name or f"geom{geom}", pose, [placed])


def _pose(position: Any, turn: Any) -> Pose:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.reshape(turn, (3, 3)), position
    return Pose.from_matrix(matrix)
