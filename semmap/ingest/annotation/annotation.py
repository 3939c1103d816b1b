"""Semantic annotations that people draw: rooms, doors, regions and properties as map features."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path

import shapely
from shapely import MultiPolygon, Point, Polygon

from semmap.geometry.mesh import prism_mesh
from semmap.geometry.outline import placed_outline
from semmap.geometry.overlay import common
from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.annotation.connectors import add_connector
from semmap.ingest.annotation.draft_world import Draft, DraftWorld, RoomArea
from semmap.ingest.annotation.feature_file import Feature, read_features
from semmap.ingest.annotation.feature_values import (
    area_of,
    choice,
    drawn_as,
    flag_of,
    heading_of,
    number,
    pose_of,
    time_of,
)
from semmap.ingest.annotation.osm_indoor import from_osm_indoor, is_osm_indoor
from semmap.ingest.floor_plan import middle_of
from semmap.ingest.openings import LEAF_HEIGHT
from semmap.ingest.world import (
    Kind,
    PlaceDetail,
    Refused,
    RegionDetail,
    Shape,
    StoreyDetail,
    World,
)

ROOM_HEIGHT = 2.5
"""Height of the solid of a room whose ceiling is unknown, metres."""

CABIN = "elevator_cabin"
"""The type of a room that states whose cabin it is, but no type."""

THIN = 1e-6
"""Least height of an entity that has one, metres."""


def _add_storey(world: DraftWorld, draft: Draft) -> None:
    """Add a storey: its elevation, its clear height, and its outline where it is drawn."""
    feature = draft.feature
    level = StoreyDetail(number(feature, "elevation") or 0.0, number(feature, "height"))
    if level.height is not None and level.height < THIN:
        raise Refused(f"its height is {level.height}", "Give the clear height in metres.")
    shapes = []
    if isinstance(feature.geometry, Polygon | MultiPolygon):
        area = area_of(feature, world.out.notes)
        shapes = [Shape("polygon", prism_mesh(area, 0.0, level.height or ROOM_HEIGHT), area)]
    world.storeys[draft.name] = level
    world.add(draft, Pose(z=level.elevation), None, detail=level, shapes=shapes)


def _add_elevator(world: DraftWorld, draft: Draft) -> None:
    """Add an elevator at the middle of what is drawn."""
    geometry = draft.feature.geometry
    pose = None
    if geometry is not None:
        middle = geometry.centroid
        pose = Pose.planar(middle.x, middle.y, heading_of(draft.feature))
    world.add(draft, pose, None)


def _add_room(world: DraftWorld, draft: Draft) -> None:
    """Add a room; its ceiling is the storey's height by default, and unknown beside a top."""
    feature = draft.feature
    storey = world.storey_of(feature)
    floor = number(feature, "floor") or 0.0
    ceiling, top = number(feature, "ceiling"), number(feature, "top")
    if ceiling is None and top is None and storey in world.storeys:
        ceiling = world.storeys[storey].height
    if ceiling is not None or top is None:
        top = floor + ROOM_HEIGHT if ceiling is None else ceiling
    _check_heights(floor, top)
    place = PlaceDetail(floor, ceiling, world.elevator_of(feature))
    if place.elevator is not None and draft.type is None:
        draft = replace(draft, type=CABIN)
    pose, shapes = _placed(world, feature, storey, floor, top)
    world.add(draft, pose, storey, detail=place, shapes=shapes)
    if shapes:
        world.rooms.append(RoomArea(draft.name, area_of(feature, []), storey, floor, top))


def _add_object(world: DraftWorld, draft: Draft) -> None:
    """Add an object or agent, which is in its room; the import derives what holds an object."""
    feature = draft.feature
    storey = world.storey_of(feature) if feature.geometry is not None else None
    floor, ceiling = number(feature, "floor") or 0.0, number(feature, "ceiling")
    height = number(feature, "height")
    if height is None and ceiling is not None:
        height = ceiling - floor
    if height is not None and height < THIN:
        raise Refused("it has no height", "Give height in metres, or ceiling above floor.")
    own, shape = pose_of(feature), world.mesh_of(feature)
    pose, shapes = _placed(world, feature, storey, 0.0, height, own, shape)
    if pose is not None:
        pose = Pose(z=floor) @ pose
    if "model_name" in feature.properties:  # where a simulator has it counts
        model = world.models.get(str(feature.properties["model_name"]))
        if model is None:
            raise Refused("its model is not in the world", "Remove its feature, too.")
        pose = model.pose
        outlines = [each.outline for each in shapes]
        shapes = [
            replace(own, outline=outline)
            for own, outline in zip(model.shapes, outlines, strict=False)
        ] or shapes
    relation = choice(feature, "relation", ("in", "on"), "in")
    room = world.room_at(feature.geometry, storey) if draft.kind == "agent" else None
    holder = world.holder_of(feature) or (storey if room is None else room.name)
    world.add(draft, pose, holder, shapes=shapes, relation=relation)


def _add_region(world: DraftWorld, draft: Draft) -> None:
    """Add a region, held by the room that it lies in; it reaches to that room's ceiling."""
    feature = draft.feature
    for key in {"blocked", "home"} & feature.properties.keys():
        feature.properties[key] = flag_of(feature.properties[key], key)
    storey = world.storey_of(feature) if feature.geometry is not None else None
    room = world.room_at(feature.geometry, storey)
    floor, ceiling = number(feature, "floor") or 0.0, number(feature, "ceiling")
    if ceiling is None:
        ceiling = max(room.ceiling if room else ROOM_HEIGHT, floor + LEAF_HEIGHT)
    _check_heights(floor, ceiling)
    pose, shapes = _placed(world, feature, storey, floor, ceiling)
    holder = world.holder_of(feature) or (room.name if room else storey)
    since, until = time_of(feature, "valid_from"), time_of(feature, "valid_until")
    if since is not None and until is not None and until <= since:
        raise Refused("it is valid until before it begins", "Correct valid_from or valid_until.")
    detail = None if since is None and until is None else RegionDetail(since, until)
    world.add(draft, pose, holder, detail=detail, shapes=shapes)


def _overlaps(rooms: list[RoomArea]) -> list[str]:
    """Return a note for each two rooms of a storey that share floor: probably a slip."""
    notes = []
    tree = shapely.STRtree([room.area for room in rooms])
    for i, room in enumerate(rooms):
        for j in tree.query(room.area, predicate="intersects"):
            other = rooms[j]
            if j > i and room.storey == other.storey:
                shared = common(room.area, other.area).area
                if shared > 0.01:
                    notes.append(f"{room.name} and {other.name} overlap by {shared:.2f} m2")
    return notes


def _check_heights(floor: float, ceiling: float) -> None:
    if ceiling < floor + THIN:
        raise Refused(f"its ceiling {ceiling} is not above its floor {floor}", "Correct them.")


def _placed(
    world: DraftWorld,
    feature: Feature,
    storey: str | None,
    low: float,
    high: float | None,
    own: Pose | None = None,
    shape: Shape | None = None,
) -> tuple[Pose | None, list[Shape]]:
    """The pose and shape of a polygon or point in the map; without `high`, its outline alone.

    The pose of a place is in it. That of a thing is `own` in the frame at the centroid of what is
    drawn, which a change of coordinates moves along; `shape` is that of its mesh.
    """
    geometry = feature.geometry
    yaw, elevation = heading_of(feature), world.elevation(storey)
    if geometry is None:
        return None, []
    if isinstance(geometry, Point):
        pose = Pose.planar(geometry.x, geometry.y, yaw, elevation) @ (own or IDENTITY)
        return pose, [] if shape is None else [shape]
    if not isinstance(geometry, Polygon | MultiPolygon):
        raise Refused(f"is drawn as {drawn_as(feature)}", "Draw it as a polygon or a point.")
    area = area_of(feature, world.out.notes)
    middle = middle_of(area) if own is None else area.centroid
    own = own or IDENTITY
    pose = Pose.planar(middle.x, middle.y, yaw, elevation) @ own
    upright = math.hypot(own.qx, own.qy) < THIN
    outline = placed_outline(area, pose.inverse()) if upright else None
    if shape is not None:
        concave = area.area < (1 - THIN) * area.convex_hull.area
        return pose, [replace(shape, outline=outline if concave else None)]
    if outline is None:
        raise Refused("its pose is tilted", "Give its mesh, too, or an upright pose.")
    low -= own.z
    if high is None:
        return pose, [Shape("polygon", None, shapely.force_3d(outline, low))]
    return pose, [Shape("polygon", prism_mesh(outline, low, high - own.z), outline)]


KINDS: dict[Kind, Callable[[DraftWorld, Draft], None]] = {
    "storey": _add_storey,
    "elevator": _add_elevator,
    "room": _add_room,
    "connector": add_connector,
    "region": _add_region,
    "object": _add_object,
    "agent": _add_object,
}
"""How each kind is added."""

ORDER: tuple[tuple[Kind, ...], ...] = (
    ("storey",),
    ("elevator",),
    ("room",),
    ("connector",),
    ("region", "object", "agent"),
)
"""The kinds in the order in which they are added, each with those that hold one another."""


def read_annotation(
    path: Path,
    types: Collection[str] | None = None,
    georeference: Mapping[str, float] | None = None,
) -> World:
    """Return the world that the features of a GeoJSON file or GeoPackage describe.

    Features with OpenStreetMap's indoor tags are read as such (see `osm_indoor`).
    A feature whose type is none of `types` is left out; by default any type is taken.

    Coordinates are metres in the map's frame. Degrees, and coordinates of a projection of the
    earth, are brought into the frame of a map with a `georeference`; without one, they set it.
    Heights (`floor`, `ceiling`) are above the feature's
    storey, or above the map's origin where it has none. Properties that every feature
    may have: `kind` (default: that of its layer, else that of its `type` in the T-Box), `name`,
    `type` (``DiningTable``, ``dining table`` or ``dining_table``), `label`, `storey` (where the
    file has several, it or `floor` is needed), `holder`, `heading` (radians, or `heading_deg`),
    `front`. Others become free properties.

    - room: polygon, `floor`, `ceiling`, `elevator` (the elevator whose cabin it is); where the
      ceiling is unknown, `top` of its solid
    - connector: the line of the opening, or a point with `width` and `heading`; `joins`
      (``"bath,hall"``, the first being where x comes from; by default the places on both sides
      of the line), `state`, `direction`, `behaviour`; `height` of the clear opening, `step` of its
      threshold, `permissions` of which one is needed (``"staff,cleaning"``). Stairs and ramps are
      lines along the way.
    - region: polygon or point; `blocked`, `home`
    - storey: `elevation`, `height`; elevator; object (polygon with `height`, or point); agent.
      Both may have a `mesh`, a file beside this one, in its own frame, and a `pose` of this frame
      (x, y, z, qx, qy, qz, qw) from the centroid of its drawing, at its floor, turned by `heading`;
      `relation`: whether it is ``in`` (the default) or ``on`` its `holder`
    - without a geometry: an entry with nothing but its semantics

    Raises
    ------
    WorldError
        The file as a whole cannot be trusted. A feature that cannot be used is in `skipped`.
    """
    file = read_features(Path(path), georeference)
    if is_osm_indoor(file.features):
        file = from_osm_indoor(file)
    return draft_entries(DraftWorld(Path(path), file, types))


def draft_entries(draft_world: DraftWorld) -> World:
    """Return the world of all features of a draft."""
    for kinds in ORDER:
        for draft in draft_world.drafts_of(kinds):
            draft_world.attempt(draft.feature, KINDS[draft.kind], draft_world, draft)
    draft_world.out.notes += _overlaps(draft_world.rooms)
    if draft_world.without_storey:
        first, *more = draft_world.without_storey
        who = f"{first} names" if not more else f"{first} and {len(more)} more name"
        draft_world.out.notes.append(f"{who} no storey: floor is above the map's origin")
    return draft_world.out
