"""Universal Scene Description (USD), read by its own library in a process of its own.

A component (a prim of this kind) is one object with all that is below it. Elsewhere each prim with
a surface is an object; a transform with nothing but one of these gives it name and pose, as Blender
and other programs write it, unless the prim's own name means another type: then it is a group. So
does a transform above a prim whose name says nothing.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh
from semmap.ingest.annotation.feature_values import supertypes
from semmap.ingest.meshes.mesh_file import Y_UP
from semmap.ingest.naming import guess_type, words
from semmap.ingest.scenes.polygon_mesh import polygon_mesh
from semmap.ingest.scenes.scene_nodes import SceneNode, rigid_pose, scene_world
from semmap.ingest.scenes.solids import solid
from semmap.ingest.scenes.usd_crate import check_crates
from semmap.ingest.scenes.usd_size import stage_size
from semmap.ingest.sdf.elements import Unusable, leaving_out
from semmap.ingest.sdf.models import Role
from semmap.ingest.world import Skipped, World, WorldError
from semmap.limits import EXTENT, MESH_BYTES, NESTING, PARTS, PRIMS, TRIANGLES
from semmap.own_process import ProcessEnded, call_apart

AXES = {
    "X": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "Y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "Z": np.eye(3),
}
"""Rotations of a solid along z to the axis that a prim states."""

SILENT = frozenset({"geom", "geometry", "mesh", "shape", "visual"})
"""Names of prims that do not describe the object."""

HIDDEN = {"visual": ("guide", "proxy"), "collision": ("guide", "render")}
"""The purposes of prims that are not read."""


def read_usd(path: Path, *, geometry: Role = "visual") -> World:
    """Return the world of a USD stage, with its unit and its up axis.

    The nearest prim above an object that is an object, too, holds it. Invisible prims and guides
    are left out, proxies unless `geometry` is collision. Needs the extra `semmap[usd]`.

    Raises
    ------
    WorldError
        The stage cannot be opened, or it has more than the limits allow.
    """
    refused = partial(WorldError, path, "file")
    MESH_BYTES.check(path.stat().st_size, refused, "Split it into several files.")
    try:
        nodes, skipped, has_unit = call_apart(_read, path, geometry)
    except ProcessEnded as error:
        fix = "The file may be damaged: export it again."
        raise WorldError(path, "file", f"cannot be read by USD: it {error}", fix) from error
    world = scene_world(path, nodes, skipped=skipped)
    if not has_unit:
        world.notes.append(
            "the stage states no metersPerUnit: its unit is a centimetre, as in all USD"
        )
    return world


def _read(path: Path, geometry: Role) -> tuple[list[SceneNode], list[Skipped], bool]:
    """Return the objects of a stage, those left out, and whether it states its unit."""
    os.environ["PXR_WORK_THREAD_LIMIT"] = "1"  # at damaged data, threads wait for ever
    try:
        from pxr import Tf, UsdGeom
    except ImportError as error:
        fix = "Install the extra: pip install 'semmap[usd]'."
        raise WorldError(path, "file", f"needs {error.name}", fix) from error
    skipped: list[Skipped] = []
    try:
        with _diagnostics(skipped):
            stage = _opened(path)
            nodes = _UsdScene(path, stage, geometry, skipped).nodes()
    except UnicodeDecodeError as error:  # of a name, or of a message that quotes one
        raise WorldError(path, "file", "is not UTF-8", "Save it as UTF-8.") from error
    except Tf.ErrorException as error:  # a value of another type than its name says
        raise _not_a_stage(path, error) from error
    return nodes, skipped, bool(UsdGeom.StageHasAuthoredMetersPerUnit(stage))


def _opened(path: Path) -> Any:
    from pxr import Sdf, Usd

    check_crates(path, partial(WorldError, path, "file"))
    try:
        size = stage_size(Sdf.Layer.FindOrOpen(str(path)))
        if math.isinf(size):
            raise WorldError(path, "file", "its prims contain each other", "Remove the cycle.")
        PRIMS.check(size, partial(WorldError, path, "file"), "Split the stage.")
        return Usd.Stage.Open(str(path))
    except WorldError:
        raise
    except Exception as error:  # Tf.ErrorException has all messages of the parser
        raise _not_a_stage(path, error) from error


def _not_a_stage(path: Path, error: Exception) -> WorldError:
    problem = f"is not a stage of USD ({' '.join(str(error).split())[:200]})"
    return WorldError(path, "file", problem, "The file may be truncated: export it again.")


@contextmanager
def _diagnostics(skipped: list[Skipped]) -> Iterator[None]:
    """Take the warnings of USD, such as those of missing files, as what is left out."""
    from pxr import UsdUtils

    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    yield
    for found in delegate.TakeUncoalescedDiagnostics():
        problem = " ".join(str(found.commentary).split())[:300]
        fix = "Put the files that it names where it says."
        if Skipped("stage", problem, fix) not in skipped:
            skipped.append(Skipped("stage", problem, fix))


@contextmanager
def _reading(where: str) -> Iterator[None]:
    """Leave out a prim at which USD fails, or whose attributes have values of another type."""
    from pxr import Tf

    try:
        yield
    except (Tf.ErrorException, KeyError, TypeError, ValueError) as error:
        if isinstance(error, UnicodeDecodeError | WorldError):
            raise
        problem = f"cannot be read ({' '.join(str(error).split())[:200]})"
        raise Unusable(where, problem, "Correct its attributes.") from error


class _UsdScene:
    """The objects of a stage."""

    def __init__(self, path: Path, stage: Any, role: Role, skipped: list[Skipped]) -> None:
        from pxr import Usd, UsdGeom

        self.path, self.stage, self.skipped = path, stage, skipped
        self.hidden = HIDDEN[role]
        self.time = Usd.TimeCode.EarliestTime()
        self.cache = UsdGeom.XformCache(self.time)
        metres = float(UsdGeom.GetStageMetersPerUnit(stage))
        if not (math.isfinite(metres) and metres > 0):
            fix = "Give a number above 0: 1 for metres, 0.01 for centimetres."
            raise WorldError(path, "metersPerUnit", f"is {metres}", fix)
        turn = Y_UP if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y else np.eye(3)
        self.to_map = np.eye(4)
        self.to_map[:3, :3] = metres * turn

    def nodes(self) -> list[SceneNode]:
        """Return the objects, each after those above it."""
        found: dict[Any, SceneNode] = {}
        faces = 0
        for parts, prim in enumerate(self._surfaces(), 1):
            PARTS.check(parts, partial(WorldError, self.path, str(prim.GetPath())), "Split it.")
            with leaving_out(self.skipped), _reading(str(prim.GetPath())):
                mesh = self._mesh(prim)
                faces += len(mesh.faces)
                refused = partial(WorldError, self.path, str(prim.GetPath()))
                TRIANGLES.check(faces, refused, "Split the stage, or simplify its meshes.")
                self._node(_owner(prim), found).meshes.append(mesh)
        for prim in self._without_files():
            if not any(path.HasPrefix(prim.GetPath()) for path in found):
                with leaving_out(self.skipped), _reading(str(prim.GetPath())):
                    self._node(_component(prim) or prim, found).lost = True
        for path, node in found.items():
            above = path.GetParentPath()
            while node.above is None and not above.isEmpty and not above.IsAbsoluteRootPath():
                node.above, above = found.get(above), above.GetParentPath()
        return sorted(found.values(), key=lambda node: len(_above(node)))

    def _surfaces(self) -> Iterator[Any]:
        """Yield the visible prims that have a surface."""
        from pxr import Usd, UsdGeom

        prims = iter(Usd.PrimRange(self.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
        for prim in prims:
            depth = prim.GetPath().pathElementCount
            refused = partial(WorldError, self.path, str(prim.GetPath())[:100])
            NESTING.check(depth, refused, "Nest it less deeply.", "is nested:")
            shown = UsdGeom.Imageable(prim)
            if shown and (
                shown.GetVisibilityAttr().Get(self.time) == UsdGeom.Tokens.invisible
                or shown.ComputePurpose() in self.hidden
            ):
                prims.PruneChildren()
            elif prim.IsA(UsdGeom.PointInstancer):
                self._skip(prim, "places copies by a PointInstancer", "Write them out as prims.")
                prims.PruneChildren()
            elif prim.IsA(UsdGeom.Gprim):
                yield prim

    def _without_files(self) -> list[Any]:
        """The visible prims whose reference or payload is missing: they have a pose, no surface."""
        from pxr import Usd, UsdGeom

        prims = Usd.PrimRange(self.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
        found = [prim for prim in prims if prim.GetPrimIndex().localErrors]
        self.stage.SetEditTarget(self.stage.GetSessionLayer())
        for prim in found:
            if not prim.GetTypeName() and not prim.IsInstanceProxy():
                prim.SetTypeName("Xform")  # the missing file would give a type; without, no pose
        hidden = UsdGeom.Tokens.invisible
        return [p for p in found if UsdGeom.Imageable(p).ComputeVisibility(self.time) != hidden]

    def _skip(self, prim: Any, problem: str, fix: str) -> None:
        self.skipped.append(Skipped(str(prim.GetPath()), problem, fix))

    def _node(self, prim: Any, found: dict[Any, SceneNode]) -> SceneNode:
        path = prim.GetPath()
        if path not in found:
            found[path] = SceneNode(_name(prim), rigid_pose(self._matrix(prim)))
        return found[path]

    def _matrix(self, prim: Any) -> NDArray[np.float64]:
        """Return the transform (4, 4) of a prim to the map."""
        placed = np.array(self.cache.GetLocalToWorldTransform(prim), np.float64).T
        matrix: NDArray[np.float64] = self.to_map @ placed
        where = str(prim.GetPath())
        if not np.isfinite(matrix).all():
            raise Unusable(where, "its transform is not finite", "Correct it.")
        reach = float(np.abs(matrix[:3, 3]).max())
        EXTENT.check(reach, partial(Unusable, where), "Correct its transform.", "reaches")
        return matrix

    def _mesh(self, prim: Any) -> Mesh:
        """Return the surface of a prim in the map."""
        local, matrix = self._surface(prim, str(prim.GetPath())), self._matrix(prim)
        with np.errstate(all="ignore"):  # what is not finite is refused below
            vertices = local.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        if not np.isfinite(vertices).all():
            raise Unusable(str(prim.GetPath()), "its points are not finite", "Export it again.")
        mirrored = np.linalg.det(matrix[:3, :3]) < 0
        return Mesh(vertices, local.faces[:, ::-1] if mirrored else local.faces)

    def _surface(self, prim: Any, where: str) -> Mesh:
        from pxr import UsdGeom

        def value(name: str) -> Any:
            return prim.GetAttribute(name).Get(self.time)

        if prim.IsA(UsdGeom.Mesh):
            left = value("orientation") == UsdGeom.Tokens.leftHanded
            points, counts, corners = (
                value(name) for name in ("points", "faceVertexCounts", "faceVertexIndices")
            )
            return polygon_mesh(points, counts, corners, where, left_handed=left)
        kind = str(prim.GetTypeName())
        if kind == "Cube":
            return solid("box", where, size=[float(value("size"))] * 3)
        if kind == "Sphere":
            return solid("sphere", where, radius=float(value("radius")))
        if kind == "Plane":
            x, y = float(value("width")), float(value("length"))
            made = solid("plane", where, size=(x, y))
        elif kind in ("Cylinder", "Capsule", "Cone"):
            sizes = {"radius": float(value("radius")), "length": float(value("height"))}
            made = solid(kind.lower(), where, **sizes)
        else:
            raise Unusable(where, f"a {kind} has no surface that is read", "Convert it to a Mesh.")
        return Mesh(made.vertices @ AXES[str(value("axis"))].T, made.faces)


def _component(prim: Any) -> Any:
    """Return the highest component above a prim; None where there is none."""
    from pxr import Kind, Usd

    found, parent = None, prim
    while (parent := parent.GetParent()) and not parent.IsPseudoRoot():
        if Kind.Registry.IsA(Usd.ModelAPI(parent).GetKind(), Kind.Tokens.component):
            found = parent
    return found


def _owner(prim: Any) -> Any:
    """Return the prim that is the object to which a prim with a surface belongs."""
    owner = _component(prim)
    if owner is not None:
        return owner
    owner, above = prim, prim.GetParent()
    if _is_frame(above) and len(_children(above)) == 1 and not _is_other(prim, above):
        owner = above
    while _says_nothing(owner) and _is_frame(owner.GetParent()):
        if sum(map(_says_nothing, _children(owner.GetParent()))) > 1:
            break
        owner = owner.GetParent()
    return owner


def _is_other(prim: Any, above: Any) -> bool:
    """Return whether the name of a prim means a type, and not one of the transform above it."""
    own, outer = (guess_type(str(each.GetName())) for each in (prim, above))
    if own is None or outer is None:
        return own is not None
    return own.type not in supertypes(outer.type) and outer.type not in supertypes(own.type)


def _name(prim: Any) -> str:
    """Return the name of a prim, of one whose name says nothing that of the transform above it."""
    while _says_nothing(prim) and _is_frame(prim.GetParent()):
        prim = prim.GetParent()
    return str(prim.GetName())


def _says_nothing(prim: Any) -> bool:
    found = words(prim.GetName())
    return bool(found) and SILENT.issuperset(found)


def _children(prim: Any) -> list[Any]:
    from pxr import Usd

    return list(prim.GetFilteredChildren(Usd.TraverseInstanceProxies()))


def _is_frame(prim: Any) -> bool:
    """Return whether a prim is a transform below the root of its stage."""
    is_root = prim.IsPseudoRoot() or prim == prim.GetStage().GetDefaultPrim()
    return not is_root and prim.GetTypeName() == "Xform"


def _above(node: SceneNode) -> list[SceneNode]:
    found, above = [], node.above
    while above is not None:
        found.append(above)
        above = above.above
    return found
