"""What the rules of a check look at: the entities of a map, and which of them are near."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import STRtree

from semmap.geometry.contact import heights_at, touches
from semmap.query.map_check.reader import CheckedEntity

CONTACT = 0.03
"""Metres between things that touch, and by which solids may overlap: percepts and models of rooms
are this exact, and holders are derived with it."""

FASTENED = 0.05
"""Metres from a wall to what hangs on it, and of air under what stands: hooks, frames and feet are
seldom modelled."""

WALL = 0.3
"""Metres of the thickest usual wall: outlines of rooms may follow either face of it, and its door
may be drawn on either, too."""

CEILING = 0.5
"""Metres beneath a ceiling that is only a number: slabs and suspended ceilings lie between."""

SLAB, TALL = 0.5, 1.8
"""Metres: parts of a building are flatter or taller than that, and span rooms."""

STEP = 0.5
"""Metres of height by which a floor may differ from its storey, its doors from it: a few steps."""

SAMPLES = 200
"""Points of an underside, and corners of a support, along which gaps are measured."""

Floats = NDArray[np.float64]


class CheckedBuilding:
    """The entities of a map, sorted by what the rules need."""

    def __init__(self, entities: list[CheckedEntity]) -> None:
        self.entities = entities
        self.by_id = {e.row["id"]: e for e in entities}
        placed = [e for e in entities if e.pose is not None]
        self.storeys = [e for e in placed if e.kind == "storey"]
        self.rooms = [e for e in placed if e.kind == "room" and e.outline is not None]
        self.doors = [e for e in placed if e.kind == "connector"]
        self.objects = [e for e in placed if e.kind == "object"]
        self.agents = [e for e in placed if e.kind == "agent"]
        self.solids = [e for e in self.objects if len(e.triangles)]
        self._parts: dict[str, bool] = {}

    def floor(self, room: CheckedEntity) -> float:
        """The z of a room's floor."""
        assert room.pose is not None
        return float(room.pose.z + room.row["floor"])

    def ceiling(self, room: CheckedEntity) -> float:
        """The z of a room's ceiling: as stated, else the top of its shape; never under 2 m."""
        assert room.pose is not None
        stated = room.row["ceiling"]
        top = room.high[2] if stated is None else room.pose.z + stated
        return float(top if stated is not None else max(top, self.floor(room) + 2.5))

    @cached_property
    def room_tree(self) -> STRtree:
        """By the numbers of rooms."""
        return STRtree([room.outline for room in self.rooms])

    def shares(self, entity: CheckedEntity) -> dict[str, float]:
        """Which part of an entity's ground is in each room at the height of its middle."""
        ground, middle = entity.ground, float(entity.low[2] + entity.high[2]) / 2
        found = {}
        for number in self.room_tree.query(ground, predicate="intersects"):
            room = self.rooms[number]
            if self.floor(room) - CONTACT <= middle <= self.ceiling(room) + CONTACT:
                area = ground.area
                share = ground.intersection(room.outline).area / area if area else 1.0
                found[room.name] = float(share)
        return found

    def distance_to_rooms(self, entity: CheckedEntity) -> float:
        """Metres from an entity's ground to the nearest room at its height."""
        middle = float(entity.low[2] + entity.high[2]) / 2
        level = [r for r in self.rooms if self.floor(r) - STEP <= middle <= self.ceiling(r) + STEP]
        return min((float(entity.ground.distance(r.outline)) for r in level), default=np.inf)

    @cached_property
    def built_over(self) -> shapely.Geometry:
        """All rooms with what is between them: walls, shafts and columns."""
        if not self.rooms:
            return shapely.Polygon()
        whole = shapely.union_all([room.outline for room in self.rooms])
        whole = whole.buffer(WALL, join_style="mitre").buffer(-WALL, join_style="mitre")
        return shapely.union_all([shapely.Polygon(p.exterior) for p in shapely.get_parts(whole)])

    def is_part(self, entity: CheckedEntity) -> bool:
        """Whether an object is a part of the building: by its type, else by shape and place."""
        if entity.name not in self._parts:
            self._parts[entity.name] = bool(entity.row["structure"]) or self._has_form(entity)
        return self._parts[entity.name]

    def _has_form(self, entity: CheckedEntity) -> bool:
        """Flat or tall and over half of a room; or tall, thin and between rooms."""
        if entity.outline is None:
            return False
        height = (entity.high - entity.low)[2]
        if SLAB < height < TALL:
            return False
        around = shapely.box(*entity.low[:2], *entity.high[:2])
        if around.area >= 1:
            for number in self.room_tree.query(around, predicate="intersects"):
                ground = self.rooms[number].ground
                if around.intersection(ground).area >= ground.area / 2:
                    return True
        if height < TALL or not self.rooms:
            return False
        sides = shapely.get_coordinates(entity.outline.minimum_rotated_rectangle)
        thin = min(np.linalg.norm(np.diff(sides[:3], axis=0), axis=1), default=0) <= WALL
        return bool(thin) and sum(self.shares(entity).values()) < 0.5

    @cached_property
    def _solid_tree(self) -> STRtree:
        return STRtree([shapely.box(*e.low[:2], *e.high[:2]) for e in self.solids])

    def near(self, entity: CheckedEntity, distance: float) -> list[CheckedEntity]:
        """The other solids whose boxes are within a distance."""
        around = shapely.box(*(entity.low[:2] - distance), *(entity.high[:2] + distance))
        others = (self.solids[n] for n in np.sort(self._solid_tree.query(around)))
        return [
            other
            for other in others
            if other is not entity
            and other.low[2] <= entity.high[2] + distance
            and other.high[2] >= entity.low[2] - distance
        ]

    @cached_property
    def grounds(self) -> list[tuple[shapely.Geometry | None, float]]:
        """Floors that are only numbers: of rooms and storeys, and outside of them the lowest."""
        found = [(room.outline, self.floor(room)) for room in self.rooms]
        found += [(None, float(s.pose.z)) for s in self.storeys if s.pose is not None]
        return found or [(None, min((float(e.low[2]) for e in self.solids), default=0.0))]

    def gap_beneath(self, entity: CheckedEntity) -> tuple[float, str | None]:
        """Metres of air under an object, inf over nothing, and what is beneath: None is a floor."""
        least, name = np.inf, None
        for outline, z in self.grounds:
            meets = outline is None or outline.intersects(entity.ground)
            if meets and float(entity.high[2]) >= z - CONTACT:
                least = min(least, max(float(entity.low[2]) - z, 0.0))
        if least <= FASTENED:
            return least, name
        under = entity.triangles[entity.face_boxes[0][:, 2] <= entity.low[2] + CONTACT]
        points = _samples(under)
        points = points[points[:, 2] <= entity.low[2] + CONTACT]
        for other in self.beneath(entity):
            gap = _gap(points, under, other.faces_over(*_box(under)))
            if gap < least:
                least, name = gap, other.name
            if least <= FASTENED:
                break
        return least, name

    def beneath(self, entity: CheckedEntity) -> list[CheckedEntity]:
        """Other solids over which an object is, wholly or in part; the highest first."""
        around = shapely.box(*entity.low[:2], *entity.high[:2])
        found = [self.solids[n] for n in self._solid_tree.query(around)]
        below = [e for e in found if e is not entity and e.low[2] < entity.low[2] + CONTACT]
        return sorted(below, key=lambda e: -float(min(e.high[2], entity.low[2])))

    def is_fastened(self, entity: CheckedEntity) -> bool:
        """Whether an object hangs on a wall, a ceiling or a larger thing beside or above it."""
        middle = float(entity.low[2] + entity.high[2]) / 2
        for room in self.rooms:
            if not self.floor(room) <= middle <= self.ceiling(room) + CEILING:
                continue  # of another storey
            if room.outline is None or room.outline.distance(entity.ground) > FASTENED:
                continue
            if abs(self.ceiling(room) - float(entity.high[2])) <= CEILING:
                return True
            if room.outline.boundary.distance(entity.ground) <= FASTENED:
                return True
        for other in self.near(entity, FASTENED):
            beside = other.low[2] <= entity.low[2] + FASTENED and (
                other.high[2] >= entity.high[2] - FASTENED
            )
            larger = np.prod(other.high - other.low) >= np.prod(entity.high - entity.low)
            above = other.high[2] > entity.high[2] and other.low[2] >= entity.low[2]
            holds = (beside and larger) or above or self.is_part(other)
            if holds and touches(entity.triangles, other.triangles, FASTENED):
                return True
        return False


def _box(triangles: Floats) -> tuple[Floats, Floats]:
    return triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))


def _gap(points: Floats, under: Floats, support: Floats) -> float:
    """Metres of air between an underside and a support; infinite where it is beside or above."""
    if not len(support):
        return float(np.inf)
    low, high = _box(under)
    tops = _samples(support)
    tops = tops[((tops[:, :2] >= low[:2]) & (tops[:, :2] <= high[:2])).all(axis=1)]
    gaps = np.concatenate(
        [
            (points[:, 2:] - heights_at(points, support)).ravel(),
            (heights_at(tops, under) - tops[:, 2:]).ravel(),
        ]
    )
    gaps = np.where(gaps >= -CONTACT, np.maximum(gaps, 0), np.inf)  # NaN: not beneath
    return float(gaps.min(initial=np.inf))


def _samples(triangles: Floats) -> Floats:
    """Corners and middles of faces, at most `SAMPLES`."""
    every = np.concatenate([triangles.reshape(-1, 3), triangles.mean(axis=1)])
    every = every[:: max(1, len(every) // (4 * SAMPLES))]
    every = np.unique(np.round(every, 4), axis=0)
    return every[:: max(1, len(every) // SAMPLES)]
