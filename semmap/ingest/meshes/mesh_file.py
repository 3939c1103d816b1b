"""Mesh files, as one surface in metres with z up, and as worlds of a single entry."""

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple
from xml.etree.ElementTree import ParseError

import numpy as np
import shapely
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import iterparse
from numpy.typing import ArrayLike, NDArray

from semmap.geometry.mesh import Mesh, join
from semmap.ingest.meshes.mesh_size import SIMPLER, MeshFileError, check_size
from semmap.ingest.meshes.obj_file import read_obj
from semmap.ingest.meshes.octomap_file import read_octomap
from semmap.ingest.naming import give_type
from semmap.ingest.world import Entry, PlaceDetail, Shape, World, WorldError
from semmap.limits import EXTENT, PARTS, TRIANGLES

Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Rotation from coordinates with y up to coordinates with z up."""

X_UP = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""Rotation from coordinates with x up (COLLADA: right -y, towards the viewer z) to z up."""


NO_SURFACE = Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32))


class MeshPart(NamedTuple):
    """A piece of a file: its node, its names, those of the node first, and its surface, metres.

    Pieces of one node, as of several materials, have the same `node`. `above` are the nodes above
    it, the nearest first; `frame` is its transform (4, 4) to the map, which may scale and mirror,
    where the format has one; `extras` are what glTF has beside it, also of nodes without a surface.
    """

    node: Hashable
    names: tuple[str, ...]
    mesh: Mesh
    above: tuple[Hashable, ...] = ()
    frame: NDArray[np.float64] | None = None
    extras: Mapping[str, Any] = MappingProxyType({})


def read_mesh(
    path: Path,
    *,
    part: str | None = None,
    center: bool = False,
    dae_up_axis: bool = True,
    scale: float = 1.0,
) -> Mesh:
    """Return the surface in a mesh file, metres, z up, all parts joined, equal vertices merged.

    The unit of COLLADA and 3MF is applied, glTF is turned from y up. `part` takes only the node or
    geometry of this name (SDF's `<submesh>`); `center` puts the middle of the bounding box at the
    origin; `dae_up_axis` follows a COLLADA file's `<up_axis>`, which Gazebo does not; `scale` is
    metres per unit of formats without units. A MeshFileError says why there is no surface.
    """
    parts = mesh_parts(path, dae_up_axis)
    meshes = [each.mesh for each in parts if len(each.mesh.faces) and part in (None, *each.names)]
    if not meshes:
        missing = "has no faces" if part is None else f"has no faces in a part named {part!r}"
        raise MeshFileError(missing, "Export it as a triangle mesh.")
    mesh = checked(tidy(join(meshes), scale))
    if center:
        mesh = Mesh(mesh.vertices - mesh.bounds.mean(axis=0), mesh.faces)
    return mesh


def mesh_parts(path: Path, dae_up_axis: bool = True) -> list[MeshPart]:
    """Return the pieces of a mesh file; a MeshFileError says why there are none."""
    if not os.path.isfile(path):  # noqa: PTH113 - False where a name is too long
        raise MeshFileError("does not exist", other_case(path) or "Restore it.")
    read = _READERS.get(path.suffix.lower(), _read_any)
    with _loading(path.suffix.lstrip(".").upper() or "a mesh"), np.errstate(all="ignore"):
        return read(path, dae_up_axis)


@contextmanager
def _loading(format_: str) -> Iterator[None]:
    """Refuse a file at which a third-party loader fails, with whatever exception."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what a loader warns of either shows below or is harmless
        try:
            yield
        except MeshFileError:
            raise
        except Exception as error:  # loaders raise anything on broken bytes
            reason = " ".join(str(error).split())[:160] or type(error).__name__
            raise MeshFileError(
                f"cannot be read as {format_} ({reason})",
                "The file may be truncated or of another format: export it again.",
            ) from error


def read_mesh_world(
    path: Path, as_: Literal["object", "room"] = "object", *, scale: float = 1.0
) -> World:
    """A world of one entry.

    A PLY file of points without faces is an object with a point cloud; the type of another object
    is guessed from the name of the file. `scale` is metres per unit of a format without units. A
    WorldError refuses a mesh that cannot be used.
    """
    path = Path(path)
    name = path.stem
    try:
        points = _read_points(path, scale) if as_ == "object" else None
        mesh = read_mesh(path, scale=scale) if points is None else points
    except MeshFileError as error:
        raise WorldError(path, "mesh", error.problem, error.fix) from error
    if points is not None:
        cloud = Shape("cloud", points, uri=path.name)
        return World(name, path, [Entry(name, kind=as_, shapes=[cloud])])
    shape = Shape("mesh", mesh, uri=path.name)
    entry = Entry(name, kind=as_, shapes=[shape])
    world = World(name, path, [entry])
    low, high = mesh.bounds
    if as_ == "object":
        give_type(entry, (name,))
    else:
        entry.type, shape.outline = "room", _footprint(mesh)
        entry.detail = PlaceDetail(float(low[2]), float(high[2]) if high[2] > low[2] else None)
        if shape.outline is None:
            hull = shapely.MultiPoint(mesh.used[:, :2]).convex_hull
            shape.outline = hull if hull.area > 0 else None
            world.notes.append(
                f"{name}: the mesh encloses no area seen from above; its convex hull is the outline"
            )
    return world


def read_shape(path: Path) -> Shape:
    """Return the shape in a mesh file: its surface, or the points of a PLY file without faces."""
    points = _read_points(path, 1.0)
    kind: Literal["mesh", "cloud"] = "mesh" if points is None else "cloud"
    return Shape(kind, read_mesh(path) if points is None else points, uri=path.name)


def _read_points(path: Path, scale: float) -> Mesh | None:
    """Return the points of a PLY file that has no faces; None for any other file."""
    if path.suffix.lower() != ".ply" or not path.is_file():
        return None
    with path.open("rb") as file:
        head = file.read(4096).split(b"end_header")[0]
    counts = dict(re.findall(rb"element\s+(vertex|face)\s+(\d+)", head))
    if int(counts.get(b"face", 0)) or not int(counts.get(b"vertex", 0)):
        return None
    TRIANGLES.check(int(counts[b"vertex"]), MeshFileError, "Export fewer points.")
    import trimesh

    with _loading("a point cloud"):
        found = trimesh.load(path, process=False)
        points = scale * np.asarray(getattr(found, "vertices", ()), float).reshape(-1, 3)
    if len(points) < int(counts[b"vertex"]):
        raise MeshFileError("has fewer points than its header says", "Export it again.")
    return checked(Mesh(np.unique(points, axis=0), np.empty((0, 3), np.int32)))


def _read_dae(path: Path, up_axis: bool) -> list[MeshPart]:
    """Read COLLADA through pycollada, with its unit, and with its up axis if required."""
    import collada

    data = path.read_bytes()
    unit, up = _dae_asset(data)
    check_size(path)
    # pycollada takes a comment inside <mesh> for an unknown primitive and drops the whole geometry
    document = collada.Collada(
        io.BytesIO(re.sub(rb"<!--.*?-->", b"", data, flags=re.DOTALL)),
        ignore=[collada.common.DaeError],
    )
    lost = len(list(document.xmlnode.iter("{*}geometry"))) - len(document.geometries)
    if lost:
        reason = document.errors[0] if document.errors else "of an unknown kind"
        problem = f"{lost} of its geometries are unreadable ({reason})"
        raise MeshFileError(problem, "Export it again.")
    to_map = np.eye(4)
    to_map[:3, :3] = unit * {"Y_UP": Y_UP, "X_UP": X_UP}.get(up if up_axis else "", np.eye(3))
    parts, faces = [], 0
    roots = document.scene.nodes if document.scene is not None else ()
    placed = _dae_geometries(roots, to_map, to_map)
    for number, (node, names, geometry, matrix, frame) in enumerate(placed, 1):
        PARTS.check(number, MeshFileError, SIMPLER)
        named = tuple(n for n in (*names, geometry.name, geometry.id) if n)
        for primitive in geometry.primitives:
            if isinstance(primitive, collada.polylist.Polylist):
                primitive = primitive.triangleset()
            if not isinstance(primitive, collada.triangleset.TriangleSet) or not len(primitive):
                continue
            mesh = _placed(primitive.vertex, primitive.vertex_index, matrix)
            faces += len(mesh.faces)
            TRIANGLES.check(faces, MeshFileError, SIMPLER)
            above = tuple(node[:end] for end in range(len(node) - 1, 0, -1))
            parts.append(MeshPart(node, named or (path.stem,), mesh, above, frame))
    return parts


def _dae_geometries(
    nodes: Iterable[Any],
    matrix: NDArray[np.float64],
    frame: NDArray[np.float64],
    above: tuple[int, ...] = (),
    names: tuple[str, ...] = (),
    is_named: bool = False,
) -> Iterator[
    tuple[tuple[int, ...], tuple[str, ...], Any, NDArray[np.float64], NDArray[np.float64]]
]:
    """Yield each placed geometry: its node, the node's name and id, itself.

    Then its transform (4, 4) and that of its node, both to the map. A node is told by its place in
    the tree: one of the library can have several. A node without name and id belongs to the one
    above it, and so does a library's node below one that has a name and nothing else.
    """
    from collada import scene

    nodes = list(nodes)
    for number, node in enumerate(nodes):
        if isinstance(node, scene.GeometryNode):
            yield above, names, node.geometry, matrix, frame
        elif isinstance(node, scene.Node):
            is_instance = isinstance(node, scene.NodeNode)
            named = node.node if is_instance else node
            own = tuple(n for n in (named.name, named.id) if n)
            if is_instance and is_named and len(nodes) == 1:
                own = ()
            placed = matrix @ np.asarray(node.matrix, float)
            is_own = bool(own) or not names
            here, around = ((*above, number), placed) if is_own else (above, frame)
            has_name = bool(named.xmlnode.get("name")) if own else is_named  # pycollada takes ids
            yield from _dae_geometries(node.children, placed, around, here, own or names, has_name)


def _dae_asset(data: bytes) -> tuple[float, str]:
    """Return the metres per unit and the up axis that a COLLADA file states; refuse a DTD."""
    unit, up = 1.0, "Y_UP"
    try:
        for _, element in iterparse(io.BytesIO(data), events=("end",), forbid_dtd=True):
            tag = element.tag.rpartition("}")[2]
            if tag == "unit":
                unit = float(element.get("meter", "1"))
            elif tag == "up_axis":
                up = (element.text or "").strip()
            elif tag == "asset":
                break
    except DefusedXmlException as error:
        raise MeshFileError(
            "declares a document type or entities, which can blow up in memory",
            "Remove the <!DOCTYPE ...> declaration.",
        ) from error
    except ParseError as error:
        raise MeshFileError(f"is not well-formed XML ({error})", "Export it again.") from error
    if not (np.isfinite(unit) and unit > 0):
        raise MeshFileError(f"its unit is {unit} m", 'Correct <unit meter="...">.')
    return unit, up


def _read_any(path: Path, up_axis: bool) -> list[MeshPart]:
    """Read any other format through trimesh."""
    import trimesh

    _check_signature(path)
    check_size(path)
    scene = trimesh.load_scene(path, process=False, skip_materials=True)
    to_map = np.eye(4)
    if path.suffix.lower() in (".gltf", ".glb"):
        to_map[:3, :3] = Y_UP
    if scene.units is not None:
        to_map[:3, :3] *= float(trimesh.units.unit_conversion(scene.units, "meters"))
    above_of, edges = scene.graph.transforms.parents, scene.graph.transforms.edge_data
    parts, faces = [], 0
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            faces += len(geometry.faces)
            TRIANGLES.check(faces, MeshFileError, SIMPLER)
            frame = to_map @ np.asarray(matrix, float)
            mesh = _placed(geometry.vertices, geometry.faces, frame)
            # a mesh of several materials: trimesh makes a node for each, under that of the file
            above = [*_ancestors(above_of, node)]
            shared = above and re.fullmatch(rf"{re.escape(above[0])}_[0-9a-f]{{6}}", str(node))
            named = above.pop(0) if shared else str(node)
            extras = edges.get((above_of.get(node), node), {}).get("metadata") or {}
            names = (named, str(node), str(name))
            parts.append(MeshPart(named, names, mesh, (*above,), frame, extras))
    for node, around in above_of.items():
        matrix, name = scene.graph[node]
        extras = edges[around, node].get("metadata")
        if extras and name is None:
            frame = to_map @ np.asarray(matrix, float)
            above = [*_ancestors(above_of, node)]
            parts.append(MeshPart(str(node), (str(node),), NO_SURFACE, (*above,), frame, extras))
    return parts


def _ancestors(parents: Mapping[Any, Any], node: Any) -> Iterator[str]:
    while (node := parents.get(node)) is not None:
        yield str(node)


def _read_obj(path: Path, _: bool) -> list[MeshPart]:
    found = read_obj(path)
    return [MeshPart(node, (*filter(None, names), path.stem), mesh) for node, names, mesh in found]


def _read_octomap(path: Path, _: bool) -> list[MeshPart]:
    check_size(path)
    return [MeshPart(path.stem, (path.stem,), read_octomap(path))]


_READERS: dict[str, Callable[[Path, bool], list[MeshPart]]] = {
    ".bt": _read_octomap,
    ".dae": _read_dae,
    ".obj": _read_obj,
    ".ot": _read_octomap,
}

_SIGNATURES: dict[str, re.Pattern[bytes]] = {
    ".glb": re.compile(rb"glTF"),
    ".gltf": re.compile(rb"\s*\{"),
    ".ply": re.compile(rb"ply\s"),
    ".off": re.compile(rb"\s*(#.*\s+)*\w*OFF"),
    ".3mf": re.compile(rb"PK"),
}
"""The first bytes of a file of each format."""


def _check_signature(path: Path) -> None:
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(512)
        file.seek(max(0, size - 512))
        tail = file.read()
    ending = path.suffix.lower()
    if ending in _SIGNATURES and not _SIGNATURES[ending].match(head.removeprefix(b"\xef\xbb\xbf")):
        raise MeshFileError(f"is not a {ending} file", "Give it the ending of what it is.")
    if ending == ".stl" and len(head) >= 84:
        binary = size == 84 + 50 * int.from_bytes(head[80:84], "little")
        if not binary and not (head.lstrip().startswith(b"solid") and b"endsolid" in tail):
            raise MeshFileError("is not an STL file, or a truncated one", "Export it again.")
    if ending == ".off" and not _has_all_lines(path):
        raise MeshFileError("has fewer lines than vertices and faces", "Export it again.")


def _has_all_lines(path: Path) -> bool:
    """Return whether an OFF file has a line for each vertex and face; the loader takes fewer."""
    lines = [line.split(b"#")[0].split() for line in path.read_bytes().splitlines()]
    words = [line for line in lines if line]
    words = words if len(words[0]) > 1 else [[w for line in words[:2] for w in line], *words[2:]]
    try:
        end = sum(map(int, words[0][1:3]))
        return len(words) > end and (end == 0 or len(words[end]) > int(words[end][0]))
    except ValueError:
        return True  # the loader says what it is


def _placed(vertices: ArrayLike, faces: ArrayLike, matrix: NDArray[np.float64]) -> Mesh:
    """Return a piece moved by its (4, 4) affine transform; mirrored faces are turned back."""
    v = np.asarray(vertices, dtype=float).reshape(-1, 3)
    f = np.asarray(faces, dtype=np.int64).reshape(-1, 3)
    if len(f) and (f.min() < 0 or f.max() >= len(v)):
        raise MeshFileError("its faces name vertices that it does not have", "Export it again.")
    if np.linalg.det(matrix[:3, :3]) < 0:
        f = f[:, ::-1]
    return Mesh(v @ matrix[:3, :3].T + matrix[:3, 3], f.astype(np.int32))


def tidy(mesh: Mesh, scale: float = 1.0) -> Mesh:
    """Return the mesh scaled, without unused vertices, with coinciding vertices merged."""
    used, faces = np.unique(mesh.faces, return_inverse=True)
    points = mesh.vertices[used] * scale + 0.0  # no negative zeros
    order = np.lexsort(points.T)
    new = np.any(np.diff(points[order], axis=0, prepend=np.nan) != 0, axis=1)
    index = np.empty(len(points), dtype=np.int32)
    index[order] = np.cumsum(new) - 1
    return Mesh(points[order][new], index[faces].reshape(-1, 3))


def checked(mesh: Mesh) -> Mesh:
    """Return the mesh; a MeshFileError refuses one that is not finite or reaches too far."""
    if not np.isfinite(mesh.vertices).all():
        raise MeshFileError("some of its coordinates are not finite numbers", "Export it again.")
    reach = float(np.abs(mesh.vertices).max())
    EXTENT.check(reach, MeshFileError, "Correct its unit or scale.", "reaches")
    return mesh


def _footprint(mesh: Mesh) -> shapely.Polygon | shapely.MultiPolygon | None:
    """Return the area that the mesh covers from above, holes filled; None without an area."""
    corners = mesh.triangles[:, :, :2]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    flat = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) > 1e-9
    if not flat.any():
        return None
    covered = shapely.union_all(shapely.polygons(corners[flat]), grid_size=1e-4)
    rings = shapely.get_parts(covered)
    filled = shapely.union_all(shapely.polygons(shapely.get_exterior_ring(rings)))
    return filled if filled.area > 0 else None


def other_case(path: Path) -> str:
    """Return a fix if the file exists under a name that differs in case only, else ""."""
    if os.path.isdir(path.parent):  # noqa: PTH112 - False where a name is too long
        for other in path.parent.iterdir():
            if other.name != path.name and other.name.lower() == path.name.lower():
                return f"There is {other.name}: correct upper and lower case."
    return ""
