"""SDF geometries as triangle meshes, in the frame of their visual or collision."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import shapely
import trimesh
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh, box_mesh, join, prism_mesh
from semmap.geometry.morphology import polygons
from semmap.geometry.pose import IDENTITY
from semmap.ingest.meshes.mesh_file import read_mesh
from semmap.ingest.meshes.mesh_size import MeshFileError
from semmap.ingest.sdf.elements import Unusable, flag, numbers
from semmap.ingest.sdf.resources import Resources
from semmap.limits import EXTENT, VERTICES

SMALLEST = 1e-6
"""Least size of a solid, metres: smaller ones cannot be computed with."""

SECTIONS = 32
"""Corners of the polygon that approximates the circle of a cylinder, cone or capsule."""


class Geometries:
    """Makes meshes of `<geometry>` elements, each mesh file read once."""

    def __init__(self, resources: Resources) -> None:
        self._resources = resources
        self._files: dict[tuple[Path, str | None, bool], Mesh | MeshFileError] = {}

    def mesh(self, geometry: Element | None, named_in: Path, where: str) -> Mesh:
        """Return the surface of a geometry; Unusable says why it has none."""
        shape = None if geometry is None else next(iter(geometry), None)
        if geometry is None or shape is None:
            raise Unusable(where, "it has no geometry", "Add one, or remove the element.")
        if shape.tag == "mesh":
            mesh = self._from_file(shape, named_in, where)
        elif shape.tag == "polyline":
            mesh = _polylines(list(geometry.iterfind("polyline")), f"{where}: polyline")
        elif shape.tag in _SOLIDS:
            mesh = _SOLIDS[shape.tag](shape, f"{where}: {shape.tag}")
        else:
            known = f"Use one of mesh, polyline, {', '.join(_SOLIDS)}."
            raise Unusable(where, f"<{shape.tag}> is not a supported surface", known)
        if not len(mesh.faces):
            raise Unusable(where, "it is too small to have a surface", "Correct size or scale.")
        _check_extent(float(np.abs(mesh.vertices).max()), where)
        return mesh

    def _from_file(self, shape: Element, named_in: Path, where: str) -> Mesh:
        uri = (shape.findtext("uri") or "").strip()
        path = self._resources.find(uri, named_in, where)
        scale = shape.find("scale")
        x, y, z = (1.0, 1.0, 1.0) if scale is None else numbers(scale, 3, f"{where}: scale")
        if not (x and y and z):
            raise Unusable(f"{where}: scale", "a factor of 0 flattens the mesh", "Correct it.")
        submesh = shape.find("submesh")
        part = None if submesh is None else (submesh.findtext("name") or "").strip() or None
        center = submesh is not None and flag(submesh.findtext("center")) is True
        mesh = self._read(path, part, center)
        if isinstance(mesh, MeshFileError):
            raise Unusable(where, f"{uri} {mesh.problem}", mesh.fix)
        return mesh if x == y == z == 1.0 else mesh.moved(IDENTITY, (x, y, z))

    def _read(self, path: Path, part: str | None, center: bool) -> Mesh | MeshFileError:
        key = (path, part, center)
        if key not in self._files:
            try:
                self._files[key] = read_mesh(path, part=part, center=center, dae_up_axis=False)
            except MeshFileError as error:
                self._files[key] = error
        return self._files[key]


def _size(shape: Element, name: str, where: str) -> float:
    (value,) = numbers(shape.find(name), 1, f"{where}: {name}")
    return _positive((value,), f"{where}: {name}")[0]


def _positive(values: tuple[float, ...], where: str) -> tuple[float, ...]:
    if min(values) < SMALLEST:
        raise Unusable(where, f"sizes must be at least {SMALLEST:g} m", "Correct the size.")
    _check_extent(max(values), where)
    return values


def _check_extent(reach: float, where: str) -> None:
    EXTENT.check(reach, partial(Unusable, where), "Correct size or scale.", "it measures")


def _box(shape: Element, where: str) -> Mesh:
    x, y, z = _positive(numbers(shape.find("size"), 3, f"{where}: size"), where)
    return box_mesh((-x / 2, -y / 2, -z / 2), (x / 2, y / 2, z / 2))


def _round(make: Callable[..., trimesh.Trimesh], **smooth: Any) -> Callable[[Element, str], Mesh]:
    """What makes a solid of a radius and a length along z, about the origin."""

    def solid(shape: Element, where: str) -> Mesh:
        r, h = _size(shape, "radius", where), _size(shape, "length", where)
        made = _of(make(radius=r, height=h, **smooth))
        z = made.vertices[:, 2]
        return Mesh(made.vertices - (0, 0, (z.min() + z.max()) / 2), made.faces)

    return solid


def _plane(shape: Element, where: str) -> Mesh:
    """The rectangle of a plane's `<size>`, about the origin, facing along its `<normal>`."""
    x, y = _positive(numbers(shape.find("size"), 2, f"{where}: size"), where)
    element = shape.find("normal")
    n = np.array((0, 0, 1) if element is None else numbers(element, 3, f"{where}: normal"), float)
    if not n.any():
        raise Unusable(f"{where}: normal", "it is zero", "Give the direction the plane faces.")
    turn = _rotation_from_z(n / np.linalg.norm(n))
    corners = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]]) / 2
    return Mesh(corners @ turn.T, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))


def _polylines(shapes: list[Element], where: str) -> Mesh:
    """Outlines of `<point>`s, extruded from 0 to `<height>`; one in another is a hole."""
    outline: shapely.Geometry = shapely.Polygon()
    for shape in shapes:
        points = [numbers(p, 2, f"{where}: point") for p in shape.findall("point")]
        VERTICES.check(len(points), partial(Unusable, where), "Simplify it.", "an outline has")
        ring = shapely.Polygon(points) if len(points) > 2 else shapely.Polygon()
        if not ring.is_valid or ring.area == 0:
            problem = "an outline needs three points and an area, and may not cross itself"
            raise Unusable(where, problem, "Correct its points.")
        away = max(map(abs, ring.bounds))
        EXTENT.check(away, partial(Unusable, where), "Correct its unit.", "an outline reaches")
        outline = shapely.symmetric_difference(outline, ring)
    height = _size(shapes[0], "height", where)
    areas = [p for p in polygons(outline) if p.area > 0]
    if not areas:
        raise Unusable(where, "its outlines cancel out", "Remove the repeated outline.")
    return join([prism_mesh(area, 0.0, height) for area in areas])


_SOLIDS: dict[str, Callable[[Element, str], Mesh]] = {
    "box": _box,
    "cylinder": _round(trimesh.creation.cylinder, sections=SECTIONS),
    "sphere": lambda shape, where: _ball((_size(shape, "radius", where),) * 3),
    "ellipsoid": lambda shape, where: _ball(
        _positive(numbers(shape.find("radii"), 3, f"{where}: radii"), where)
    ),
    "capsule": _round(trimesh.creation.capsule, count=[SECTIONS, SECTIONS]),
    "cone": _round(trimesh.creation.cone, sections=SECTIONS),
    "plane": _plane,
}
"""The shapes that are not read from files, by element."""


def _ball(radii: tuple[float, ...]) -> Mesh:
    ball = _of(trimesh.creation.icosphere(subdivisions=2, radius=1.0))
    return Mesh(ball.vertices * np.asarray(radii), ball.faces)


def _of(solid: trimesh.Trimesh) -> Mesh:
    return Mesh(np.asarray(solid.vertices, dtype=float), np.asarray(solid.faces, dtype=np.int32))


def _rotation_from_z(n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) rotation that turns z into the unit vector `n` by the shortest way."""
    if n[2] < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    v = np.array([[0, 0, n[0]], [0, 0, n[1]], [-n[0], -n[1], 0]])
    turn: NDArray[np.float64] = np.eye(3) + v + v @ v / (1 + n[2])
    return turn
