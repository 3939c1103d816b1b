"""SDF models with their includes and nested models, baked into one shape each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal, get_args
from xml.etree.ElementTree import Element

import numpy as np

from semmap.geometry.mesh import Mesh, join
from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.sdf.elements import Unusable, flag, leaving_out, local_pose, read_root
from semmap.ingest.sdf.frames import Frames
from semmap.ingest.sdf.geometries import Geometries
from semmap.ingest.sdf.resources import Resources, model_name
from semmap.ingest.world import Shape, Skipped, World, WorldError, unique_name
from semmap.limits import EXTENT, NESTING, PARTS, TRIANGLES

Role = Literal["visual", "collision"]

MODEL_FRAME = "__model__"

LIGHTS = ("sun",)
"""Gazebo's own models that are only a light: not an object, whether or not their file is there."""


@dataclass(frozen=True)
class SdfFile:
    """The file being read, and those that include it, outermost first; `depth` counts models."""

    path: Path
    chain: tuple[Path, ...] = ()
    depth: int = 0

    def included(self, path: Path) -> SdfFile:
        """Return the file to which an include in this file leads."""
        return SdfFile(path, (*self.chain, self.path.resolve()), self.depth)

    def __str__(self) -> str:
        """Return the prefix for elements of an included file; empty for the world's own file."""
        return f"{self.path.parent.name}/{self.path.name}: " if self.chain else ""


@dataclass(frozen=True)
class _Part:
    """A visual or collision, and its pose in the model's frame."""

    role: Role
    pose: Pose
    geometry: Element | None
    path: Path
    where: str

    def holds(self, tag: str) -> bool:
        """Return whether its geometry is an element of this name."""
        return self.geometry is not None and self.geometry.find(tag) is not None

    @property
    def is_level_box(self) -> bool:
        """Whether it is a box whose edges lie along the model's axes."""
        turned = np.abs(self.pose.rotation_matrix)
        return self.holds("box") and bool(np.allclose(np.sort(turned), [0, 0, 1], atol=1e-9))


@dataclass
class SdfModel:
    """A `<model>` where it is placed; placed elsewhere, it shares its content."""

    name: str
    source: str  # name of its model file; of an inline model, its own
    frames: Frames
    pose: Pose = IDENTITY  # in the scope around it, relative to a frame of it
    relative_to: str = ""
    static: bool = False
    parts: list[_Part] = field(default_factory=list)
    wrapped: tuple[SdfModel, Pose] | None = None  # all that it has: another model, its pose
    mass: float | None = None  # of its links, kilograms, where they state one

    def unwrapped(self) -> tuple[SdfModel, Pose]:
        """Return the innermost model of nested wrappers, and its pose in this model's frame."""
        model, pose = self, IDENTITY
        while model.wrapped is not None:
            model, inner = model.wrapped
            pose = pose @ inner
        return model, pose


def _mass(model: Element, nested: Sequence[SdfModel]) -> float | None:
    """Return the mass that the links of a model and its inner models state; None if none does."""
    masses = [inner.mass for inner in nested if inner.mass is not None]
    for stated in model.iterfind("link/inertial/mass"):
        with suppress(ValueError):
            mass = float(stated.text or "")
            if 0 < mass < math.inf:
                masses.append(mass)
    return sum(masses) if masses else None


class Models:
    """Reads models, each file once, and bakes them, each shape once."""

    def __init__(self, world: World, resources: Resources) -> None:
        self._world, self._resources = world, resources
        self._geometries = Geometries(resources)
        self._files: dict[Path, SdfModel | Unusable | None] = {}
        self._baked: dict[tuple[tuple[int, Pose], ...], Mesh | None] = {}

    def placed(self, scope: Element, frames: Frames, source: SdfFile) -> list[SdfModel]:
        """Return the models and includes in a scope; add their frames under unique names."""
        found = []
        for element in scope:
            if element.tag not in ("model", "include"):
                continue
            with leaving_out(self._world.skipped):
                read = self._read if element.tag == "model" else self._include
                model: SdfModel | None = read(element, source)
                if model is None:
                    continue
                name = unique_name(model.name, frames)
                if name != model.name:
                    self._world.notes.append(f"{source}another {model.name} is called {name}")
                frames.add(name, model.pose, model.relative_to, model.frames)
                if flag(element.get("merge")):
                    for inner in model.frames.names():
                        if inner not in frames:
                            frames.add(inner, IDENTITY, f"{name}::{inner}")
                found.append(replace(model, name=name))
        return found

    def model(self, folder: Path, where: str) -> SdfModel | None:
        """Return the model in a folder; None for one that cannot be used, which is skipped."""
        with leaving_out(self._world.skipped):
            return self._file(str(folder.resolve()), SdfFile(self._world.source), where)
        return None

    def _include(self, element: Element, source: SdfFile) -> SdfModel | None:
        """Return the model that an include places; None for a light."""
        uri = (element.findtext("uri") or "").strip()
        given = (element.findtext("name") or "").strip()
        name = model_name(uri)
        where = f"{source}include {given or name}".rstrip()
        if not name:
            raise Unusable(where, "it has no <uri>", "Name the model that it includes.")
        model: SdfModel | None
        model = SdfModel(name, name, Frames(source.path, f"model {name}", MODEL_FRAME))
        with leaving_out(self._world.skipped):  # without the model, its name and pose are known
            model = self._file(uri, source, where)
        if model is None:
            return None
        static = flag(element.findtext("static"))
        pose, relative_to = model.pose, ""
        if element.find("pose") is not None:
            local, relative_to = local_pose(element, where)
            placement = element.findtext("placement_frame") or element.get("placement_frame")
            pose = _placed(local, model.frames, placement)
        return replace(
            model,
            name=given or model.name,
            pose=pose,
            relative_to=relative_to,
            static=model.static if static is None else static,
        )

    def _file(self, uri: str, source: SdfFile, where: str) -> SdfModel | None:
        """Return the model of a file, read once; None for a light."""
        try:
            path = self._resources.model_file(uri, source.path, where)
        except Unusable:
            if model_name(uri) in LIGHTS:
                return None
            raise
        key = path.resolve()
        if key in (*source.chain, source.path.resolve()):
            problem = f"{uri} leads back to {path.name}, which includes this file"
            fix = "Remove one of the includes in the circle."
            raise WorldError(source.path, where, problem, fix)
        if key not in self._files:
            try:
                self._files[key] = self._included(path, uri, source, where)
            except WorldError as error:  # one broken model does not cost the world
                problem = f"{uri} cannot be used: {error.element} {error.problem}"
                self._files[key] = Unusable(where, problem, error.fix)
        found = self._files[key]
        if isinstance(found, Unusable):
            raise found
        return found

    def _included(self, path: Path, uri: str, source: SdfFile, where: str) -> SdfModel | None:
        root = read_root(path)
        element = root.find("model")
        if element is None:
            if root.find("light") is not None:
                return None
            held = ", ".join(f"<{e.tag}>" for e in root) or "nothing"
            raise Unusable(where, f"{uri} holds {held}", "Include a file that holds a <model>.")
        model = self._read(element, source.included(path))
        return replace(model, source=model_name(uri))

    def _read(self, element: Element, source: SdfFile) -> SdfModel:
        name = element.get("name", "").strip() or "model"
        where = f"{source}model {name}"
        source = replace(source, depth=source.depth + 1)
        refused = partial(WorldError, source.path, where)
        NESTING.check(source.depth, refused, "Nest models less deeply.", "nests models:")
        frames = Frames(source.path, where, MODEL_FRAME)
        nested = self.placed(element, frames, source)
        links = self.add_frames(element, frames, where)
        frames.check()
        parts = self._parts(links, frames, source.path, where)
        wrapped: tuple[SdfModel, Pose] | None = None
        count = len(parts) + sum(len(inner.parts) for inner in nested)
        PARTS.check(count, refused, "Split it, or nest fewer models.")
        for inner in nested:
            with leaving_out(self._world.skipped):
                stands = frames.pose(inner.name, f"{where}: model {inner.name}")
                parts += [replace(p, pose=stands @ p.pose) for p in inner.parts]
                if len(nested) == 1 and not links:
                    wrapped = (inner, stands)
        static = flag(element.findtext("static"))
        pose, relative_to = local_pose(element, where)
        return SdfModel(
            name,
            source=name if wrapped is None else wrapped[0].source,
            frames=frames,
            pose=_placed(pose, frames, element.get("placement_frame")),
            relative_to=relative_to,
            static=nested[0].static if wrapped and static is None else static is True,
            parts=parts,
            wrapped=wrapped,
            mass=_mass(element, nested),
        )

    def add_frames(self, scope: Element, frames: Frames, where: str) -> list[tuple[str, Element]]:
        """Add links, frames and joints; return the links, each with the name of its frame."""
        links = []
        for tag in ("link", "frame", "joint"):
            for element in scope.iterfind(tag):
                given = element.get("name") or tag
                with leaving_out(self._world.skipped):
                    pose, relative_to = local_pose(element, f"{where}: {tag} {given}")
                    if tag == "frame":
                        relative_to = relative_to or element.get("attached_to", "").strip()
                    elif tag == "joint":
                        relative_to = relative_to or (element.findtext("child") or "").strip()
                    name = unique_name(given, frames)
                    frames.add(name, pose, relative_to)
                    if tag == "link":
                        links.append((name, element))
        return links

    def _parts(
        self, links: list[tuple[str, Element]], frames: Frames, path: Path, where: str
    ) -> list[_Part]:
        parts = []
        for frame, link in links:
            for role in get_args(Role):
                for element in link.iterfind(role):
                    named = f"{where}: link {frame}: {role} {element.get('name', '')}".rstrip()
                    with leaving_out(self._world.skipped):
                        local, relative_to = local_pose(element, named)
                        pose = frames.pose(relative_to or frame, named) @ local
                        parts.append(_Part(role, pose, element.find("geometry"), path, named))
        return parts

    def shape(self, model: SdfModel, role: Role) -> Shape | None:
        """Return all surfaces of a model as one mesh in its frame; None where it has none.

        Where none of the requested role can be read, those of the other role are used. What only
        collides is in a robot's way, too: it stands for a model without visuals.
        """
        parts = self._bounded(model, role)
        mesh = self._mesh(parts, self._world.skipped)
        if mesh is None and (parts or role == "visual"):
            role = "collision" if role == "visual" else "visual"
            parts = self._bounded(model, role)
            mesh = self._mesh(parts, skipped=[])
            if mesh is not None:
                self._note(f"model {model.source}: its {role} geometry is used")
        if mesh is None:
            return None
        is_box = len(parts) == 1 and parts[0].is_level_box
        return Shape("box" if is_box else "mesh", mesh, role=role)

    def _bounded(self, model: SdfModel, role: Role) -> list[_Part]:
        """Return the parts of a role that have an extent.

        A plane collides without bound whatever its size, so a model that collides as a plane is
        endless ground, and the rectangle that shows it is not an object.
        """
        endless = any(p.holds("plane") and p.role == "collision" for p in model.parts)
        parts = []
        for part in (p for p in model.parts if p.role == role and not p.holds("empty")):
            if endless and part.holds("plane"):
                self._note(f"model {model.source}: an endless plane is kept without geometry")
            else:
                parts.append(part)
        return parts

    def _mesh(self, parts: list[_Part], skipped: list[Skipped]) -> Mesh | None:
        key = tuple((id(part.geometry), part.pose) for part in parts)
        if key not in self._baked:
            surfaces, faces = [], 0
            fix = "Split the model, or simplify its meshes."
            for part in parts:
                with leaving_out(skipped):
                    surface = self._surface(part)
                    faces += len(surface.faces)
                    refused = partial(Unusable, part.where)
                    TRIANGLES.check(faces, refused, fix, "with it the model has")
                    surfaces.append(surface)
            self._baked[key] = join(surfaces) if len(surfaces) > 1 else next(iter(surfaces), None)
        return self._baked[key]

    def _surface(self, part: _Part) -> Mesh:
        mesh = self._geometries.mesh(part.geometry, part.path, part.where)
        if part.pose != IDENTITY:
            mesh = mesh.moved(part.pose)
        reach, refused = float(np.abs(mesh.vertices).max()), partial(Unusable, part.where)
        fix = "Correct its pose, size or scale."
        EXTENT.check(reach, refused, fix, "from its model's origin it reaches")
        return mesh

    def _note(self, note: str) -> None:
        if note not in self._world.notes:
            self._world.notes.append(note)


def _placed(pose: Pose, inner: Frames, placement: str | None) -> Pose:
    """Return the pose of a model whose inner frame `placement`, if named, is at `pose`."""
    return pose @ inner.pose(placement.strip()).inverse() if placement else pose
