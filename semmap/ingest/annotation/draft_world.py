"""The world that is built from map features: its entries, and what they refer to."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely
from shapely import MultiPolygon, Polygon

from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.annotation.feature_file import Feature, FeatureFile
from semmap.ingest.annotation.feature_values import kind_of, number, text, type_of
from semmap.ingest.floor_plan import middle_of
from semmap.ingest.meshes.mesh_file import read_shape
from semmap.ingest.meshes.mesh_size import MeshFileError
from semmap.ingest.world import (
    OUTSIDE,
    Entry,
    Kind,
    Refused,
    Shape,
    StoreyDetail,
    World,
    unique_name,
)
from semmap.suggestions import similar_names

_COMMON = {"name", "kind", "type", "label", "storey", "holder", "heading", "heading_deg", "front"}
_HEIGHTS = {"floor", "ceiling"}
_OPENING = {"width", "height", "step"}
_SHAPE = {"height", "pose", "mesh", "model_name", "relation"}
_PASSAGE = {"joins", "state", "behaviour", "direction", "permissions"}
USED_PROPERTIES: dict[Kind, set[str]] = {
    "storey": _COMMON | {"elevation", "height"},
    "elevator": _COMMON,
    "room": _COMMON | _HEIGHTS | {"elevator", "top"},
    "connector": _COMMON | _OPENING | _PASSAGE | {"floor", "rise"},
    "region": _COMMON | _HEIGHTS | {"valid_from", "valid_until"},
    "object": _COMMON | _HEIGHTS | _SHAPE,
    "agent": _COMMON | _HEIGHTS | _SHAPE,
}
"""Properties that become parts of an entry of this kind; all others stay free properties."""

NESTED = "properties"
"""The property with free properties, as an object, whose names have a meaning of their own."""


@dataclass(frozen=True)
class RoomArea:
    """A room: its area in the map's frame and the name of its entry."""

    name: str
    area: Polygon | MultiPolygon
    storey: str | None
    floor: float
    ceiling: float


@dataclass(frozen=True)
class Draft:
    """A feature with its kind, type and unique name."""

    feature: Feature
    kind: Kind
    type: str | None
    name: str


class DraftWorld:
    """A world that grows kind by kind, each holder before what it holds; `poses` are in the map."""

    def __init__(
        self,
        path: Path,
        file: FeatureFile,
        types: Collection[str] | None = None,
        models: Mapping[str, Entry] | None = None,
    ) -> None:
        self._types = types  # None: any
        self.file = file
        self.models = models or {}
        self._meshes: dict[str, Shape] = {}
        self.out = World(
            path.stem,
            path,
            skipped=self.file.skipped,
            notes=self.file.notes,
            georeference=self.file.georeference,
            surveyed=self.file.surveyed,
        )
        self.poses: dict[str, Pose | None] = {}
        self.storeys: dict[str, StoreyDetail] = {}
        self.rooms: list[RoomArea] = []
        self.without_storey: dict[str, None] = {}  # features whose floor is above the map's origin
        self._names = {OUTSIDE}
        self._given = {str(f.properties.get("name", "")).strip() for f in self.file.features}
        self.drafts: list[Draft] = []
        for feature in self.file.features:
            self.attempt(feature, self._draft, feature)
        self.kinds: dict[str, Kind] = {draft.name: draft.kind for draft in self.drafts}

    def attempt(self, feature: Feature, make: Callable[..., None], *arguments: Any) -> None:
        """Call `make`; a feature that it refuses is left out and named."""
        with self.file.leaving_out(feature.where, feature.properties.get("name")):
            make(*arguments)

    def _draft(self, feature: Feature) -> None:
        type_ = type_of(feature)
        if type_ is not None and self._types is not None and type_ not in self._types:
            similar = similar_names(type_, self._types)
            correct = f"Correct it ({' or '.join(similar)})" if similar else "Correct it"
            raise Refused(
                f"its type {text(feature, 'type')!r} is none that the map has",
                f"{correct}, or import with --define (define=True), which adds it.",
            )
        kind = kind_of(feature, type_)
        given = text(feature, "name")
        if given == OUTSIDE:
            raise Refused(f"is named {OUTSIDE}", "Give it a name that means nothing else.")
        if given is None:
            free = (f"{type_ or kind}{n}" for n in itertools.count(1))
            name = next(n for n in free if n not in self._names and n not in self._given)
        else:
            name = unique_name(given, self._names)
            if name != given:
                self.out.notes.append(f"{feature.where}: {given} is taken, this one is {name}")
        self._names.add(name)
        self.drafts.append(Draft(feature, kind, type_, name))

    def drafts_of(self, kinds: Sequence[Kind]) -> list[Draft]:
        """Return the drafts of some kinds, each after its holder; those in a circle come last."""
        waiting = {d.name: d for kind in kinds for d in self.drafts if d.kind == kind}
        ready: list[Draft] = []
        while waiting:
            held = {name: str(d.feature.properties.get("holder")) for name, d in waiting.items()}
            free = [name for name, holder in held.items() if holder not in waiting]
            ready += [waiting.pop(name) for name in free or held]
        return ready

    def add(self, draft: Draft, pose: Pose | None, holder: str | None, **parts: Any) -> None:
        """Add an entry with `detail` and `shapes`, at a pose in the map, None for no place.

        The holder is an entry that has a place, or a storey that no feature draws, which the map
        must have, and whose origin is the map's.
        """
        feature = draft.feature
        own = pose
        if pose is not None and holder is not None:
            outer = self.poses.get(holder, IDENTITY)
            if outer is None:
                raise Refused(f"its holder {holder} has no place", "Draw the holder, too.")
            own = outer.inverse() @ pose
        used = USED_PROPERTIES[draft.kind]
        free = {k: v for k, v in feature.properties.items() if k not in used}
        if isinstance(free.get(NESTED), dict):
            free |= free.pop(NESTED)
        entry = Entry(
            draft.name,
            draft.kind,
            draft.type,
            text(feature, "label"),
            free,
            holder if pose is not None else None,
            own,
            front=number(feature, "front") or 0.0,
            **parts,
        )
        self.poses[draft.name] = pose
        self.out.entries.append(entry)

    def is_left_out(self, name: str | None) -> bool:
        """Return whether the file has a feature of this name that cannot be used."""
        return name in self.file.lost and name not in self.poses

    def _named(self, feature: Feature, kind: Kind) -> str | None:
        """Return the storey or elevator that a feature names."""
        given = text(feature, kind)
        if given is not None and self.kinds.get(given, kind) != kind:
            problem = f"its {kind} {given} is a {self.kinds[given]}"
            raise Refused(problem, f"Name a feature of kind {kind}.")
        return given

    def storey_of(self, feature: Feature) -> str | None:
        """Return the storey that a feature names, else the only one, else None.

        Where there are several, a feature that names none needs a floor above the map's origin.
        """
        if self.is_left_out(text(feature, "storey")):
            problem = f"its storey {text(feature, 'storey')} is left out"
            raise Refused(problem, "Correct that feature.")
        given = self._named(feature, "storey")
        if given is None and len(self.storeys) == 1:
            return next(iter(self.storeys))
        if given is None and self.storeys and feature.geometry is not None:
            if number(feature, "floor") is None:
                problem = f"it names no storey, and the file has {len(self.storeys)}"
                raise Refused(problem, "Add the property storey, or floor above the map's origin.")
            self.without_storey[feature.where] = None
        return given

    def elevation(self, storey: str | None) -> float:
        """Return the height of a storey's floor above the map's origin, metres; 0 if unknown."""
        return self.storeys[storey].elevation if storey in self.storeys else 0.0

    def elevator_of(self, feature: Feature) -> str | None:
        """Return the elevator that a feature names; one that nothing draws is added."""
        given = self._named(feature, "elevator")
        if given is not None and given not in self.poses:
            self.out.notes.append(f"{feature.where}: elevator {given} is added, nothing draws it")
            self._names.add(given)
            self.kinds[given], self.poses[given] = "elevator", None
            self.out.entries.append(Entry(given, "elevator", "elevator", pose=None))
        return given

    def holder_of(self, feature: Feature) -> str | None:
        """Return the holder that a feature names."""
        holder = text(feature, "holder")
        if holder is not None and holder not in self.poses:
            problem = f"its holder {holder} is not a feature of this file"
            raise Refused(problem, "Name a feature that can be used.")
        return holder

    def mesh_of(self, feature: Feature) -> Shape | None:
        """Return the shape in the mesh file that a feature names, each file read once."""
        given = text(feature, "mesh")
        if given is None:
            return None
        if given not in self._meshes:
            try:
                self._meshes[given] = read_shape(self.out.source.parent / given)
            except MeshFileError as error:
                raise Refused(f"its mesh {given} {error.problem}", error.fix) from error
        return self._meshes[given]

    def room(self, name: str) -> RoomArea | None:
        """Return a room by its name; None where it has no area."""
        return next((room for room in self.rooms if room.name == name), None)

    def floor_of(self, room: RoomArea) -> float:
        """Return the z of the floor of a room in the map's frame."""
        return self.elevation(room.storey) + room.floor

    def rooms_on(self, storey: str | None) -> Sequence[RoomArea]:
        """Return the rooms of a storey."""
        return [room for room in self.rooms if room.storey == storey]

    def room_at(self, geometry: shapely.Geometry | None, storey: str | None) -> RoomArea | None:
        """Return the room that covers the middle of a geometry."""
        if geometry is None:
            return None
        middle = middle_of(geometry) if geometry.area > 0 else geometry.centroid
        return next((r for r in self.rooms_on(storey) if r.area.covers(middle)), None)
