"""Doors, openings, stairs and ramps from map features."""

from __future__ import annotations

import math
from typing import Any, Literal, cast

import shapely
from shapely import LineString, Point

from semmap.geometry.pose import Pose
from semmap.ingest.annotation.draft_world import Draft, DraftWorld
from semmap.ingest.annotation.feature_file import Feature
from semmap.ingest.annotation.feature_values import (
    choice,
    heading_of,
    line_of,
    number,
    supertypes,
    text,
)
from semmap.ingest.floor_plan import middle_of, rooms_beside
from semmap.ingest.openings import BEHAVIOURS, WIDER, approach_pose, door_leaf, opening_pose
from semmap.ingest.world import OUTSIDE, ConnectorDetail, Refused

REACH = 0.5
"""Distance from its line within which a door looks for the places that it joins, metres."""

OPENING = "opening"
"""The type of connectors that have no leaf."""

Form = Literal["door", "elevator_door", "stairs", "ramp"]
FORMS: tuple[Form, ...] = ("elevator_door", "stairs", "ramp", "door")
Joined = tuple[str, str] | None
"""The places that a feature names."""


def add_connector(world: DraftWorld, draft: Draft) -> None:
    """Add a connector between the places that it names, or that lie on its sides or at its ends."""
    feature = draft.feature
    above = supertypes(draft.type or "door")
    form: Form = next((f for f in FORMS if f in above), "door")
    joins = _joins(world, feature)
    detail = _detail(feature, form, OPENING in above, joins)
    if feature.geometry is None:
        if joins is None:
            raise Refused("it has no geometry and names no places", "Draw it, or add joins.")
        world.add(draft, None, None, detail=detail)
    elif form in ("stairs", "ramp"):
        _add_way(world, draft, detail, joins)
    else:
        _add_opening(world, draft, detail, joins)


def _detail(feature: Feature, form: Form, is_opening: bool, joins: Joined) -> ConnectorDetail:
    """Return what the properties of a feature state; places and poses are filled in later."""
    detail = ConnectorDetail(
        joins or ("", ""),
        (approach_pose(Pose(), None, -1), approach_pose(Pose(), None, 1)),
        form,
        cast(Any, choice(feature, "direction", ("both", "forward", "backward"), "both")),
        cast(Any, choice(feature, "state", ("open", "closed", "locked"), "open")),
        text(feature, "behaviour") or ("drive_through" if is_opening else BEHAVIOURS[form]),
        number(feature, "width"),
        number(feature, "height"),
        number(feature, "step") or 0.0,
        _permissions(feature),
    )
    for key in ("width", "height"):
        clear = getattr(detail, key)
        if clear is not None and clear <= 0:
            raise Refused(f"its {key} is {clear}", f"Give the clear {key} in metres.")
    if detail.step < 0:
        raise Refused(f"its step is {detail.step}", "Give the height of the threshold.")
    if detail.direction != "both" and joins is None:
        raise Refused("it has a direction but does not name what it joins", "Add joins.")
    return detail


def _permissions(feature: Feature) -> tuple[str, ...]:
    given = feature.properties.get("permissions")
    if isinstance(given, list):
        return tuple(map(str, given))
    return tuple(w.strip() for w in (text(feature, "permissions") or "").split(",") if w.strip())


def _joins(world: DraftWorld, feature: Feature) -> Joined:
    """Return the two places that a feature names, the outside second."""
    given = feature.properties.get("joins")
    if given is None or given == "":
        return None
    names = given.split(",") if isinstance(given, str) else given
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        raise Refused(f"joins {str(given)[:60]!r}", 'Write it as "bath,hall".')
    places = [n.strip() for n in names]
    if len(places) != 2 or not all(places) or places == [OUTSIDE, OUTSIDE]:
        raise Refused(f"joins {', '.join(places) or 'nothing'}", "Name two places.")
    for place in places:
        if world.is_left_out(place):
            raise Refused(f"joins {place}, which is left out", "Correct that feature.")
        if world.kinds.get(place, "room") != "room":
            raise Refused(f"joins {place}, which is not a room", "Name two rooms.")
    if places[0] == OUTSIDE:
        places.reverse()
    return places[0], places[1]


def _storey_of(world: DraftWorld, feature: Feature, joins: Joined) -> str | None:
    """Return the storey that a connector names, else that of the first place that it joins."""
    if joins is not None and text(feature, "storey") is None:
        for room in world.rooms:
            if room.name in joins:
                return room.storey
    return world.storey_of(feature)


def _add_opening(world: DraftWorld, draft: Draft, detail: ConnectorDetail, joins: Joined) -> None:
    """Add a door: x of its frame leads through it, from its first place to its second."""
    line = line_of(draft.feature, world.out.notes)
    if detail.width is not None and detail.width > line.length + WIDER:
        raise Refused(
            f"its width is {detail.width:g} m, but its line is {line.length:.2f} m long",
            "Draw the line from post to post, or correct the width.",
        )
    storey = _storey_of(world, draft.feature, joins)
    rooms = world.rooms_on(storey)
    sides = rooms_beside([room.area for room in rooms], line, reach=REACH)
    left, right = (rooms[i].name if i is not None else None for i in (sides.left, sides.right))
    if joins is None:
        joins = _places_beside(draft.name, left, right, [room.name for room in rooms], world)
    points = shapely.get_coordinates(line)
    along = math.atan2(*(points[1] - points[0])[::-1])
    from_left = _leads_from_left(world, line, joins, left, right)
    beside = any((place == left) != (place == right) for place in joins)
    if not beside and "heading" in draft.feature.properties:
        from_left = math.sin(along - heading_of(draft.feature)) > 0
    floor = number(draft.feature, "floor")
    beside_it = [room for room in map(world.room, joins) if room is not None]
    lowest = min(map(world.floor_of, beside_it), default=world.elevation(storey))
    z = lowest if floor is None else world.elevation(storey) + floor
    pose = opening_pose(line, from_left, z)
    areas = [None if room is None else room.area for room in map(world.room, joins)]
    detail.places, detail.width = joins, detail.width or line.length
    detail.poses = approach_pose(pose, areas[0], -1), approach_pose(pose, areas[1], 1)
    has_leaf = OPENING not in supertypes(draft.type or "door")
    shapes = [door_leaf(detail.width)] if has_leaf else []
    world.add(draft, pose, storey, detail=detail, shapes=shapes)


def _places_beside(
    name: str, left: str | None, right: str | None, order: list[str], world: DraftWorld
) -> tuple[str, str]:
    """Return the places on both sides of a line, in the file's order; else one and the outside."""
    if left is None and right is None:
        raise Refused(
            f"touches no room within {REACH} m and names none",
            "Draw it along the wall between two rooms, or add joins.",
        )
    if left == right:
        raise Refused(f"has {left} on both sides", "Draw it between rooms, or add joins.")
    first, *second = sorted((side for side in (left, right) if side), key=order.index)
    if not second:
        world.out.notes.append(f"{name}: nothing but {first} beside it, so it leads out")
    return first, second[0] if second else OUTSIDE


def _leads_from_left(
    world: DraftWorld,
    line: LineString,
    joins: tuple[str, str],
    left: str | None,
    right: str | None,
) -> bool:
    """Return whether the first place lies left of the line, or else the second right of it."""
    (ax, ay), (bx, by) = shapely.get_coordinates(line)

    def side(place: str) -> float:
        if (place == left) != (place == right):
            return 1.0 if place == left else -1.0
        room = world.room(place)
        if room is None:
            return 0.0
        to = middle_of(room.area)
        return float((bx - ax) * (to.y - ay) - (by - ay) * (to.x - ax))

    first = side(joins[0])
    return first > 0 or (first == 0 and side(joins[1]) < 0)


def _add_way(world: DraftWorld, draft: Draft, detail: ConnectorDetail, joins: Joined) -> None:
    """Add stairs or a ramp: a line along the way, from its first place to its second."""
    line = line_of(draft.feature, world.out.notes)
    storey = _storey_of(world, draft.feature, joins)
    ends = [Point(p) for p in shapely.get_coordinates(line)]
    if joins is None:
        found = [world.room_at(end, storey) for end in ends]
        if found[0] is None or found[1] is None or found[0] is found[1]:
            raise Refused("its ends do not lie in two rooms and it names none", "Add joins.")
        joins = found[0].name, found[1].name
    heights = [
        world.floor_of(room) if (room := world.room(place)) else world.elevation(storey)
        for place in joins
    ]
    floor, rise = number(draft.feature, "floor"), number(draft.feature, "rise")
    foot = heights[0] if floor is None else world.elevation(storey) + floor
    rise = heights[1] - foot if rise is None else rise
    detail.places, half = joins, line.length / 2
    middle, yaw = line.centroid, math.atan2(ends[1].y - ends[0].y, ends[1].x - ends[0].x)
    pose = Pose.planar(middle.x, middle.y, yaw, foot)
    detail.poses = (
        Pose.planar(-half, 0.0),
        Pose.planar(half, 0.0, math.pi, rise),
    )
    world.add(draft, pose, storey, detail=detail)
