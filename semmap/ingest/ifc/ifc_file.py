"""An IFC file: its elements with their solids in metres, and what it says about them."""

from __future__ import annotations

import math
import multiprocessing
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.ingest.world import WorldError
from semmap.limits import EXTENT, MESH_BYTES, TRIANGLES

SMALLER = "Export fewer elements, or simpler ones."

FACETED = ("IfcTessellatedFaceSet", "IfcFacetedBrep", "IfcFaceBasedSurfaceModel")
"""Classes of bodies that are given by their flat faces."""


@dataclass(frozen=True)
class ElementBody:
    """The surface of an element: its mesh in a frame below the middle of its box, and its pose."""

    pose: Pose
    mesh: Mesh

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """(N, 3) vertices in the file's frame, metres."""
        return self.pose.apply(self.mesh.vertices)

    @cached_property
    def triangles(self) -> NDArray[np.float64]:
        """(M, 3, 3) corners of triangles in the file's frame, metres."""
        return self.points[self.mesh.faces]

    @cached_property
    def box(self) -> NDArray[np.float64]:
        """(2, 3) lowest and highest corner in the file's frame, metres."""
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])


class IfcFile:
    """An IFC file that was read, with the solids of its elements by their global ids.

    Raises `WorldError`: IfcOpenShell is not installed, it cannot read the file, or the file has
    more than the limits allow.
    """

    def __init__(self, path: Path, progress: Callable[[str, int, int], None]) -> None:
        self.path = path
        refused = partial(WorldError, path, "file")
        MESH_BYTES.check(path.stat().st_size, refused, SMALLER)
        if (number := _repeated(path)) is not None:
            fix = "Export the building again."
            raise WorldError(path, f"#{number}", "has several entities of this number", fix)
        try:
            import ifcopenshell
            import ifcopenshell.util.unit
        except ImportError as error:
            problem, fix = f"needs {error.name}", "Install the extra: pip install 'semmap[ifc]'."
            raise WorldError(path, "file", problem, fix) from error
        try:
            self.model: Any = ifcopenshell.open(str(path))
            self.metres = float(ifcopenshell.util.unit.calculate_unit_scale(self.model))
        except Exception as error:  # IfcOpenShell raises many kinds on broken text
            reason = " ".join(str(error).split())[:160] or type(error).__name__
            fix = "It may be truncated: export it again as IFC (STEP)."
            raise WorldError(path, "file", f"cannot be read as IFC ({reason})", fix) from error
        if not self.of("IfcProject") or not _is_complete(path):
            fix = "It may be truncated: export the whole building again."
            raise WorldError(path, "file", "has no IfcProject or no end", fix)
        if not 1e-6 <= self.metres <= 1e3:
            fix = "State the length unit in IfcUnitAssignment."
            raise WorldError(path, "units", f"are of {self.metres:g} m", fix)
        self.solids = dict(self._solids(progress))

    def of(self, *classes: str) -> list[Any]:
        """The entities of classes that the schema of the file has, subclasses included."""
        found: list[Any] = []
        for each in classes:
            try:
                found += self.model.by_type(each)
            except RuntimeError:  # the schema has no such class
                continue
        return found

    def solid(self, element: Any) -> ElementBody | None:
        """The surface of an element; None where it has none."""
        return self.solids.get(element.GlobalId)

    def placement(self, element: Any) -> Pose:
        """The frame of an element in that of the file, metres; WorldError if that is broken."""
        from ifcopenshell.util.placement import get_local_placement

        try:
            matrix = np.array(get_local_placement(element.ObjectPlacement), float)
        except Exception as error:  # IfcOpenShell raises many kinds on what is not of the schema
            fix = "Export the building again."
            where = f"{element.is_a()} {element.GlobalId}"
            raise WorldError(self.path, where, "has no usable placement", fix) from error
        matrix[:3, 3] *= self.metres
        return Pose.from_matrix(matrix)

    def outlines(self, element: Any) -> list[Polygon]:
        """The outlines as drawn, in their own frames, metres, that the body of an element has.

        The body itself has them repaired: of an outline that crosses itself, only the largest part.
        """
        from ifcopenshell import geom
        from ifcopenshell.util.shape import get_edges, get_vertices

        found = []
        for profile in self.model.traverse(element.Representation):
            if not profile.is_a("IfcArbitraryClosedProfileDef"):
                continue
            try:
                line = geom.create_shape(geom.settings(), profile.OuterCurve)
            except RuntimeError:  # a curve that IfcOpenShell does not know; nor is there a body
                continue
            begin, end = np.asarray(get_edges(line), np.int64).reshape(-1, 2).T
            if len(begin) > 2 and (begin[1:] == end[:-1]).all():
                found.append(Polygon(np.asarray(get_vertices(line))[begin, :2]))
        return found

    def length(self, element: Any, attribute: str) -> float | None:
        """A length that an element states, metres; None where it states none above 0."""
        given = getattr(element, attribute, None)
        stated = float(given) * self.metres if isinstance(given, float | int) else 0.0
        return stated if 0 < stated < math.inf else None

    def properties(self, element: Any) -> dict[str, Any]:
        """What the file says about an element: its class, id, name and property sets."""
        from ifcopenshell.util.element import get_psets

        about = {"class": element.is_a(), "guid": element.GlobalId, "name": element.Name}
        tag = getattr(element, "Tag", None)
        sets = {name: _plain(values) for name, values in get_psets(element).items()}
        return {"ifc": {k: v for k, v in (about | {"tag": tag}).items() if v}, **sets}

    def _solids(
        self, progress: Callable[[str, int, int], None]
    ) -> Iterator[tuple[str, ElementBody]]:
        """Each body that has faces: by the kernel that only has flat ones where that does.

        It is twenty times as fast as Open CASCADE, which sews the faces together.
        """
        from ifcopenshell import geom
        from ifcopenshell.util.shape import get_faces, get_shape_matrix, get_vertices

        bodies = [e for e in self.of("IfcElement", "IfcSpace") if e.Representation is not None]
        left = {each.GlobalId: each for each in bodies}
        triangles = 0
        for kernel, some in (("cgal-simple", filter(_is_faceted, bodies)), ("opencascade", bodies)):
            include = [each for each in some if each.GlobalId in left]
            if not include:
                continue
            threads = multiprocessing.cpu_count()
            shapes = geom.iterator(
                geom.settings(), self.model, threads, include=include, geometry_library=kernel
            )
            going = shapes.initialize()
            while going:
                shape = shapes.get()
                progress("shapes", len(bodies) - len(left), len(bodies))
                faces = np.asarray(get_faces(shape.geometry), np.int32)
                triangles += len(faces)
                TRIANGLES.check(triangles, partial(WorldError, self.path, "file"), SMALLER)
                if len(faces):
                    vertices = np.asarray(get_vertices(shape.geometry), float)
                    matrix = np.array(get_shape_matrix(shape))
                    yield shape.guid, self._placed(matrix, vertices, faces)
                    left.pop(shape.guid, None)
                going = shapes.next()

    def _placed(
        self, matrix: NDArray[np.float64], vertices: NDArray[np.float64], faces: NDArray[np.int32]
    ) -> ElementBody:
        if not (np.isfinite(matrix).all() and np.isfinite(vertices).all()):
            fix = "Export the building again."
            raise WorldError(self.path, "placement", "puts an element at infinity", fix)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        x, y, _ = ((low + high) / 2).tolist()
        below = Pose(x, y, float(low[2]))
        pose = Pose.from_matrix(matrix) @ below
        farthest = float(np.abs(pose.translation).max() + np.abs(high - low).max())
        if EXTENT.exceeded_by(farthest):
            raise WorldError(
                self.path,
                "placement",
                f"puts an element {farthest:.0f} m from the origin",
                "Export it with the survey point in IfcMapConversion and the building at the "
                f"origin. {EXTENT.variable} raises the limit.",
            )
        return ElementBody(pose, Mesh(vertices - below.translation, faces))


def _is_faceted(element: Any) -> bool:
    """Whether the body of an element is given by its flat faces."""
    bodies = [
        each
        for each in element.Representation.Representations or ()
        if each.RepresentationIdentifier == "Body"
    ]
    items = [item for body in bodies for item in body.Items or ()]
    mapped = set()
    for item in items:
        if item.is_a("IfcMappedItem") and item.MappingSource.id() not in mapped:
            mapped.add(item.MappingSource.id())
            items += item.MappingSource.MappedRepresentation.Items or ()
    return bool(items) and all(any(map(item.is_a, (*FACETED, "IfcMappedItem"))) for item in items)


def _repeated(path: Path) -> int | None:
    """Return a number that several entities have: IfcOpenShell crashes on some of these files."""
    numbers: set[int] = set()
    with path.open("rb") as file:
        for line in file:
            if found := re.match(rb"\s*#(\d{1,18})\s*=", line):
                number = int(found[1])
                if number in numbers:
                    return number
                numbers.add(number)
    return None


def _is_complete(path: Path) -> bool:
    """Return whether the text ends as ISO 10303-21 demands: a truncated file is read in part."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 1024, 0))
        return b"END-ISO-10303-21" in file.read()


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """The values that JSON has, of a property set."""
    return {
        name: value
        for name, value in values.items()
        if name != "id"
        and isinstance(value, str | bool | int | float)
        and (not isinstance(value, float) or math.isfinite(value))
    }
