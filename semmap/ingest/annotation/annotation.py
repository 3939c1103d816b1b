"""Semantic annotations that people draw: rooms, doors, regions and properties as map features."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import shapely
from shapely import LineString, MultiPolygon, Point, Polygon

from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.annotation.feature_file import Feature, Refused, read_features
from semmap.ingest.annotation.feature_values import (
    area_about,
    area_of,
    area_prism,
    choice,
    drawn_as,
    flag_of,
    heading_of,
    kind_of,
    line_of,
    middle_of,
    number,
    supertypes,
    text,
    type_of,
)
from semmap.ingest.floor_plan import rooms_beside
from semmap.ingest.naming import unique_name
from semmap.ingest.world import (
    OUTSIDE,
    ConnectorDetail,
    Entry,
    Kind,
    PlaceDetail,
    Shape,
    StoreyDetail,
    World,
)

__all__ = ["read_annotation"]

ROOM_HEIGHT = 2.5
"""How far the solid of a room reaches up where nothing says its ceiling, metres."""

LEAF = (0.05, 2.1)
"""Thickness and height of a door's leaf, metres."""

REACH = 0.5
"""How far from its line a door looks for the places that it joins, metres."""

OPENING = "opening"
"""The type of connectors that have no leaf."""

STANDING = (0.6, 0.5, 0.4, 0.8, 1.0, 0.3)
"""Where a robot stands before a door: the first of these distances that lies in the place."""

ORDER: tuple[Kind, ...] = (
    "storey",
    "elevator",
    "room",
    "connector",
    "region",
    "object",
    "agent",
)
"""A holder comes before what it holds."""

Form = Literal["door", "elevator_door", "stairs", "ramp"]
FORMS: tuple[Form, ...] = ("elevator_door", "stairs", "ramp", "door")
BEHAVIOURS = {
    "door": "pass_door",
    "elevator_door": "call_elevator",
    "stairs": "climb_stairs",
    "ramp": "drive_through",
}
"""What passing a connector of this form needs, where the feature does not say."""

THIN = 1e-6
"""Metres that a thing is high at least, if it has a height."""

COMMON = {"name", "kind", "type", "label", "storey", "holder", "heading", "heading_deg", "front"}
TAKEN: dict[Kind, set[str]] = {
    "storey": COMMON | {"elevation", "height"},
    "elevator": COMMON,
    "room": COMMON | {"floor", "ceiling", "elevator"},
    "connector": COMMON
    | {
        "floor",
        "joins",
        "state",
        "behaviour",
        "direction",
        "width",
        "height",
        "step",
        "permissions",
    },
    "region": COMMON | {"floor", "ceiling"},
    "object": COMMON | {"floor", "ceiling", "height"},
    "agent": COMMON | {"floor", "ceiling", "height"},
}
"""Properties that become parts of an entry of this kind; all others stay free properties."""


def read_annotation(path: Path, name: str | None = None) -> World:
    """Read the features of a GeoJSON file or of all layers of a GeoPackage as entries.

    Coordinates are metres in the map's frame; heights (`floor`, `ceiling`) are above the feature's
    storey, or above the map's origin where the file has no storey. Properties that every feature
    may have: `kind` (else that of its layer, else that of its `type` in the T-Box), `name`,
    `type` (``DiningTable``, ``dining table`` or ``dining_table``), `label`, `storey` (needed where
    the file has several), `holder`, `heading` (radians, or `heading_deg`), `front`. Others become
    free properties.

    - room: polygon, `floor`, `ceiling`, `elevator` (whose cabin it is)
    - connector: the line of the opening, or a point with `width` and `heading`; `joins`
      (``"lab1,corridor1"``, the first being where x comes from; by default the places on both sides
      of the line), `state`, `direction`, `behaviour`; `height` of the clear opening, `step` of its
      threshold, `permissions` of which one is needed (``"staff,cleaning"``). Stairs and ramps are
      lines along the way.
    - region: polygon or point; `blocked`, `home`
    - storey: `elevation`, `height`; elevator; object (polygon with `height`, or point); agent
    - without a geometry: an entry with nothing but its semantics

    Parameters
    ----------
    path : ``.geojson`` or ``.gpkg``
    name : of the world, by default the file's own

    Raises
    ------
    WorldError
        The file as a whole cannot be trusted. A feature that cannot be used is in `skipped`.
    """
    return _Reading(Path(path), name).world()


# -- the world --------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Space:
    """A room: its area in the map's frame and the name of its entry."""

    name: str
    area: Polygon | MultiPolygon
    storey: str | None
    ceiling: float


@dataclass(frozen=True)
class _Draft:
    """A feature with its kind, type and unique name."""

    feature: Feature
    kind: Kind
    type: str | None
    name: str


def _leaf(width: float) -> Shape:
    """The leaf of a closed door, in the door's frame."""
    thickness, height = LEAF
    low, high = (-thickness / 2, -width / 2, 0.0), (thickness / 2, width / 2, height)
    return Shape("box", box_mesh(low, high))


class _Reading:
    """Builds the world kind by kind, so that a holder is there before what it holds."""

    def __init__(self, path: Path, name: str | None) -> None:
        self.file = read_features(path)
        self.out = World(
            name or path.stem,
            path,
            skipped=self.file.skipped,
            notes=self.file.notes,
            georeference=self.file.georeference,
        )
        self.names = {OUTSIDE}
        self.said = {str(f.properties.get("name", "")).strip() for f in self.file.features}
        self.poses: dict[str, Pose | None] = {}  # of entries, in the map
        self.storeys: dict[str, StoreyDetail] = {}
        self.spaces: list[_Space] = []
        self.drafts: list[_Draft] = []

    def world(self) -> World:
        for feature in self.file.features:
            self.attempt(feature, lambda f=feature: self.drafts.append(self.draft(f)))  # type: ignore[misc]
        self.kinds = {d.name: d.kind for d in self.drafts}
        make: dict[Kind, Callable[[_Draft], None]] = {
            "storey": self.storey,
            "elevator": self.elevator,
            "room": self.room,
            "connector": self.connector,
            "region": self.region,
            "object": self.thing,
            "agent": self.thing,
        }
        for kind in ORDER:
            for draft in self.held_later([d for d in self.drafts if d.kind == kind]):
                self.attempt(draft.feature, lambda d=draft: make[d.kind](d))  # type: ignore[misc]
        self.note_overlaps()
        return self.out

    def attempt(self, feature: Feature, make: Callable[[], None]) -> None:
        try:
            make()
        except Refused as refused:
            self.file.skip(feature.properties.get("name"), feature.where, refused)

    def draft(self, feature: Feature) -> _Draft:
        type_ = type_of(feature)
        kind = kind_of(feature, type_)
        said = text(feature, "name")
        if said == OUTSIDE:
            raise Refused(f"is named {OUTSIDE}", "Give it a name that means nothing else.")
        if said is None:
            made = (f"{type_ or kind}{n}" for n in itertools.count(1))
            name = next(n for n in made if n not in self.names and n not in self.said)
        else:
            name = unique_name(said, self.names)
            if name != said:
                self.out.notes.append(f"{feature.where}: {said} is taken, this one is {name}")
        self.names.add(name)
        return _Draft(feature, kind, type_, name)

    def held_later(self, drafts: list[_Draft]) -> list[_Draft]:
        """The drafts of one kind, each after its holder; those that hold each other come last."""
        waiting, ready = {d.name: d for d in drafts}, []
        while waiting:
            free = [
                d
                for d in waiting.values()
                if str(d.feature.properties.get("holder")) not in waiting
            ]
            for draft in free or list(waiting.values()):
                ready.append(waiting.pop(draft.name))
        return ready

    def add(self, draft: _Draft, pose: Pose | None, holder: str | None, **parts: Any) -> None:
        """Add an entry with its `pose` in the map, which becomes that in its holder.

        A storey that no feature is, is one that the map is to have, at the map's x and y.
        """
        feature = draft.feature
        outer: Pose | None = None
        if pose is not None and holder is not None:
            outer = self.poses.get(holder, IDENTITY)
            if outer is None:
                raise Refused(f"its holder {holder} has no place", "Draw the holder, too.")
        entry = Entry(
            draft.name,
            draft.kind,
            draft.type,
            text(feature, "label"),
            {k: v for k, v in feature.properties.items() if k not in TAKEN[draft.kind]},
            holder if pose is not None else None,
            outer.inverse() @ pose if outer is not None and pose is not None else pose,
            front=number(feature, "front") or 0.0,
            **parts,
        )
        self.poses[draft.name] = pose
        self.out.entries.append(entry)

    def is_left_out(self, name: str | None) -> bool:
        """Whether a feature of this name is there and could not be used."""
        return name in self.file.lost and name not in self.poses

    def storey_of(self, feature: Feature) -> str | None:
        said = text(feature, "storey")
        if self.is_left_out(said):
            raise Refused(f"its storey {said} is left out", "Mend that feature.")
        if said is not None and self.kinds.get(said, "storey") != "storey":
            raise Refused(f"its storey {said} is a {self.kinds[said]}", "Name a storey.")
        if said is None and len(self.storeys) == 1:
            return next(iter(self.storeys))
        if said is None and self.storeys:
            raise Refused(
                f"it says no storey, of which the file has {len(self.storeys)}",
                "Add the property storey.",
            )
        return said

    def elevation(self, storey: str | None) -> float:
        return self.storeys[storey].elevation if storey in self.storeys else 0.0

    def area_pose(self, area: Polygon | MultiPolygon, storey: str | None, yaw: float = 0.0) -> Pose:
        middle = middle_of(area)
        return Pose.planar(middle.x, middle.y, yaw, self.elevation(storey))

    # -- kinds --------------------------------------------------------------------------------

    def storey(self, draft: _Draft) -> None:
        feature = draft.feature
        level = StoreyDetail(number(feature, "elevation") or 0.0, number(feature, "height"))
        if level.height is not None and level.height < THIN:
            raise Refused(f"its height is {level.height}", "Give the clear height in metres.")
        shapes = []
        if isinstance(feature.geometry, Polygon | MultiPolygon):
            area = area_of(feature, self.out.notes)
            shapes = [Shape("polygon", area_prism(area, 0.0, level.height or ROOM_HEIGHT), area)]
        self.storeys[draft.name] = level
        self.add(draft, Pose(z=level.elevation), None, detail=level, shapes=shapes)

    def elevator(self, draft: _Draft) -> None:
        geometry = draft.feature.geometry
        pose = None
        if geometry is not None:
            middle = geometry.centroid
            pose = Pose.planar(middle.x, middle.y, heading_of(draft.feature))
        self.add(draft, pose, None)

    def room(self, draft: _Draft) -> None:
        feature = draft.feature
        storey = self.storey_of(feature)
        floor = number(feature, "floor") or 0.0
        ceiling = number(feature, "ceiling")
        if ceiling is None and storey in self.storeys:
            ceiling = self.storeys[storey].height
        if ceiling is not None and ceiling < floor + THIN:
            raise Refused(f"its ceiling {ceiling} is not above its floor {floor}", "Mend them.")
        place = PlaceDetail(floor, ceiling, self.elevator_of(feature))
        top = ceiling if ceiling is not None else floor + ROOM_HEIGHT
        pose, shapes = self.placed(feature, storey, floor, top)
        self.add(draft, pose, storey, detail=place, shapes=shapes)
        if shapes:
            self.spaces.append(_Space(draft.name, area_of(feature, []), storey, top))

    def elevator_of(self, feature: Feature) -> str | None:
        said = text(feature, "elevator")
        if said is not None and self.kinds.get(said, "elevator") != "elevator":
            raise Refused(f"its elevator {said} is a {self.kinds[said]}", "Name an elevator.")
        if said is not None and said not in self.poses:
            self.out.notes.append(f"{feature.where}: elevator {said} is added, nothing draws it")
            self.names.add(said)
            self.kinds[said], self.poses[said] = "elevator", None
            self.out.entries.append(Entry(said, "elevator", "elevator", pose=None))
        return said

    def placed(
        self, feature: Feature, storey: str | None, low: float, high: float | None
    ) -> tuple[Pose | None, list[Shape]]:
        """Pose and shape of a polygon or point; without `high`, the shape is the outline alone."""
        geometry = feature.geometry
        yaw = heading_of(feature)
        if geometry is None:
            return None, []
        if isinstance(geometry, Point):
            return Pose.planar(geometry.x, geometry.y, yaw, self.elevation(storey)), []
        if not isinstance(geometry, Polygon | MultiPolygon):
            raise Refused(f"is drawn as {drawn_as(feature)}", "Draw it as a polygon or a point.")
        area = area_of(feature, self.out.notes)
        pose = self.area_pose(area, storey, yaw)
        own = area_about(area, pose)
        if high is None:
            return pose, [Shape("polygon", None, shapely.force_3d(own, low))]
        return pose, [Shape("polygon", area_prism(own, low, high), own)]

    def thing(self, draft: _Draft) -> None:
        """An object or agent; import finds its holder where it says none."""
        feature = draft.feature
        storey = self.storey_of(feature) if feature.geometry is not None else None
        floor, ceiling = number(feature, "floor") or 0.0, number(feature, "ceiling")
        height = number(feature, "height")
        if height is None and ceiling is not None:
            height = ceiling - floor
        if height is not None and height < THIN:
            raise Refused("it has no height", "Give height in metres, or ceiling above floor.")
        pose, shapes = self.placed(feature, storey, 0.0, height)
        if pose is not None:
            pose = Pose(z=floor) @ pose
        self.add(draft, pose, self.holder_of(feature) or storey, shapes=shapes)

    def holder_of(self, feature: Feature) -> str | None:
        holder = text(feature, "holder")
        if holder is not None and holder not in self.poses:
            raise Refused(f"its holder {holder} is no feature here", "Name one that can be used.")
        return holder

    def region(self, draft: _Draft) -> None:
        feature = draft.feature
        for key in {"blocked", "home"} & feature.properties.keys():
            feature.properties[key] = flag_of(feature.properties[key], key)
        storey = self.storey_of(feature) if feature.geometry is not None else None
        room = self.room_at(feature.geometry, storey)
        floor, ceiling = number(feature, "floor") or 0.0, number(feature, "ceiling")
        if ceiling is None:
            ceiling = max(room.ceiling if room else ROOM_HEIGHT, floor + LEAF[1])
        if ceiling < floor + THIN:
            raise Refused(f"its ceiling {ceiling} is not above its floor {floor}", "Mend them.")
        pose, shapes = self.placed(feature, storey, floor, ceiling)
        holder = self.holder_of(feature) or (room.name if room else storey)
        self.add(draft, pose, holder, shapes=shapes)

    def room_at(self, geometry: shapely.Geometry | None, storey: str | None) -> _Space | None:
        """The room that a region lies in: the one that covers its middle."""
        if geometry is None:
            return None
        middle = middle_of(geometry) if geometry.area > 0 else geometry.centroid
        rooms = [s for s in self.spaces if s.storey == storey]
        return next((s for s in rooms if s.area.covers(middle)), None)

    # -- connectors ---------------------------------------------------------------------------

    def connector(self, draft: _Draft) -> None:
        feature = draft.feature
        above = supertypes(draft.type or "door")
        form: Form = next((f for f in FORMS if f in above), "door")
        joins = self.joins(feature)
        connects = ConnectorDetail(
            joins or ("", ""),
            (Pose.planar(-STANDING[0], 0.0), Pose.planar(STANDING[0], 0.0, math.pi)),
            form,
            cast(Any, choice(feature, "direction", ("both", "forward", "backward"), "both")),
            cast(Any, choice(feature, "state", ("open", "closed", "locked"), "open")),
            text(feature, "behaviour")
            or ("drive_through" if OPENING in above else BEHAVIOURS[form]),
            number(feature, "width"),
            number(feature, "height"),
            number(feature, "step") or 0.0,
            tuple(w.strip() for w in (text(feature, "permissions") or "").split(",") if w.strip()),
        )
        for key in ("width", "height"):
            clear = getattr(connects, key)
            if clear is not None and clear <= 0:
                raise Refused(f"its {key} is {clear}", f"Give the clear {key} in metres.")
        if connects.step < 0:
            raise Refused(f"its step is {connects.step}", "Give the height of the threshold.")
        if connects.direction != "both" and joins is None:
            raise Refused("it has a direction but does not say what it joins", "Add joins.")
        if feature.geometry is None:
            if joins is None:
                raise Refused("it has no geometry and names no places", "Draw it, or add joins.")
            self.add(draft, None, None, detail=connects)
        elif form in ("stairs", "ramp"):
            self.way(draft, connects, joins)
        else:
            self.opening(draft, connects, joins)

    def joins(self, feature: Feature) -> tuple[str, str] | None:
        """The two places that the feature names, what is outside being second."""
        said = feature.properties.get("joins")
        if said is None or said == "":
            return None
        names = said.split(",") if isinstance(said, str) else said
        if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
            raise Refused(f"joins {str(said)[:60]!r}", 'Write it as "lab1,corridor1".')
        places = [n.strip() for n in names]
        if len(places) != 2 or places[0] == places[1] or not all(places):
            raise Refused(f"joins {', '.join(places) or 'nothing'}", "Name two places.")
        for place in places:
            if self.is_left_out(place):
                raise Refused(f"joins {place}, which is left out", "Mend that feature.")
            if self.kinds.get(place, "room") != "room":
                raise Refused(f"joins {place}, which is no room", "Name two rooms.")
        if places[0] == OUTSIDE:
            places.reverse()
        return places[0], places[1]

    def opening(
        self, draft: _Draft, connects: ConnectorDetail, joins: tuple[str, str] | None
    ) -> None:
        """A door: x of its frame goes through the opening, from its first place to its second."""
        line = line_of(draft.feature, self.out.notes)
        storey = self.storey_of_joined(draft.feature, joins)
        rooms = [s for s in self.spaces if s.storey == storey]
        sides = rooms_beside([s.area for s in rooms], line, reach=REACH)
        left, right = (rooms[i].name if i is not None else None for i in (sides.left, sides.right))
        if joins is None:
            if left is None and right is None:
                raise Refused(
                    f"touches no room within {REACH} m and names none",
                    "Draw it along the wall between two rooms, or add joins.",
                )
            if left == right:
                raise Refused(f"has {left} on both sides", "Draw it between rooms, or add joins.")
            order = [s.name for s in rooms]
            first, *second = sorted((s for s in (left, right) if s), key=order.index)
            joins = first, second[0] if second else OUTSIDE
            if not second:
                self.out.notes.append(
                    f"{draft.name}: nothing but {first} beside it, so it leads out"
                )
        points = shapely.get_coordinates(line)
        along = math.atan2(*(points[1] - points[0])[::-1])
        from_left = self.leads_from_left(line, joins, left, right)
        middle = points.mean(axis=0)
        yaw = along + (-math.pi / 2 if from_left else math.pi / 2)
        pose = Pose.planar(
            float(middle[0]),
            float(middle[1]),
            yaw,
            self.elevation(storey) + (number(draft.feature, "floor") or 0.0),
        )
        width = connects.width or line.length
        connects.places, connects.width = joins, width
        connects.poses = (self.standing(pose, joins[0], -1), self.standing(pose, joins[1], 1))
        leaf = [] if OPENING in supertypes(draft.type or "door") else [_leaf(width)]
        self.add(draft, pose, storey, detail=connects, shapes=leaf)

    def storey_of_joined(self, feature: Feature, joins: tuple[str, str] | None) -> str | None:
        """The storey of a connector: its own word, or that of the first place that it joins."""
        if joins is not None and text(feature, "storey") is None:
            for space in self.spaces:
                if space.name in joins:
                    return space.storey
        return self.storey_of(feature)

    def leads_from_left(
        self, line: LineString, joins: tuple[str, str], left: str | None, right: str | None
    ) -> bool:
        """Whether the first place lies to the left of the line, or else the second to its right."""
        (ax, ay), (bx, by) = shapely.get_coordinates(line)

        def side(place: str) -> float:
            if (place == left) != (place == right):
                return 1.0 if place == left else -1.0
            space = self.space(place)
            if space is None:
                return 0.0
            to = middle_of(space.area)
            return float((bx - ax) * (to.y - ay) - (by - ay) * (to.x - ax))

        first = side(joins[0])
        return first > 0 or (first == 0 and side(joins[1]) < 0)

    def space(self, name: str) -> _Space | None:
        return next((s for s in self.spaces if s.name == name), None)

    def standing(self, pose: Pose, place: str, side: int) -> Pose:
        """Where a robot stands in the place to face the door, in the door's frame."""
        space = self.space(place)
        for distance in STANDING:
            x, y, _ = pose.apply([(side * distance, 0.0, 0.0)])[0]
            if space is None or space.area.contains(Point(x, y)):
                break
        else:
            distance = STANDING[0]
        return Pose.planar(side * distance, 0.0, 0.0 if side < 0 else math.pi)

    def way(self, draft: _Draft, connects: ConnectorDetail, joins: tuple[str, str] | None) -> None:
        """Stairs or a ramp: a line along the way, from its first place to its second."""
        line = line_of(draft.feature, self.out.notes)
        storey = self.storey_of_joined(draft.feature, joins)
        ends = [Point(p) for p in shapely.get_coordinates(line)]
        if joins is None:
            found = [self.room_at(end, storey) for end in ends]
            if found[0] is None or found[1] is None or found[0] is found[1]:
                raise Refused("its ends lie in no two rooms and it names none", "Add joins.")
            joins = found[0].name, found[1].name
        heights = [
            self.elevation(s.storey) if (s := self.space(place)) else self.elevation(storey)
            for place in joins
        ]
        connects.places, half = joins, line.length / 2
        middle, yaw = line.centroid, math.atan2(ends[1].y - ends[0].y, ends[1].x - ends[0].x)
        pose = Pose.planar(middle.x, middle.y, yaw, heights[0])
        connects.poses = (
            Pose.planar(-half, 0.0),
            Pose.planar(half, 0.0, math.pi, heights[1] - heights[0]),
        )
        self.add(draft, pose, storey, detail=connects)

    def note_overlaps(self) -> None:
        """Rooms that share floor are likely drawn over each other by mistake."""
        tree = shapely.STRtree([s.area for s in self.spaces])
        for i, space in enumerate(self.spaces):
            for j in tree.query(space.area, predicate="intersects"):
                other = self.spaces[j]
                if j > i and space.storey == other.storey:
                    common = space.area.intersection(other.area).area
                    if common > 0.01:
                        self.out.notes.append(
                            f"{space.name} and {other.name} overlap by {common:.2f} m2"
                        )
