"""What the rules of a check look at: the entities of a map, and which of them are near."""

from __future__ import annotations

from functools import cache, cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from shapely import STRtree

from semmap.geometry.contact import shared_columns
from semmap.geometry.overlay import common, united
from semmap.geometry.pose import Pose
from semmap.query.map_check.reader import CheckedEntity

CONTACT = 0.03
"""Metres between things that touch, and by which solids may overlap: percepts and models of rooms
are this exact, and holders are derived with it."""

SAME_POINT = 0.001
"""Metres: things that meet so exactly were put there by a program, not by a hand."""

TWINS, STACKED = 0.05, 0.005
"""Part of their size by which two things of one model may differ, and metres by which the bottom of
one is above that of the other; trays and cups of a stack are further apart."""

MOST_OF_IT, SOME_OF_IT = 0.5, 0.1
"""Parts of one thing that are in another at the same point: whatever its height, and if it is
deeper than a contact. Less is a foot in a rug, or a can in a plate."""

FASTENED = 0.05
"""Metres from a wall to what hangs on it, and of air under what stands: hooks, frames and feet are
seldom modelled."""

WALL = 0.3
"""Metres of the thickest usual wall: outlines of rooms may follow either face of it, and its door
may be drawn on either, too."""

THICKEST = 1.2
"""Metres of the thickest wall between two rooms that has a door."""

CEILING = 0.5
"""Metres beneath a ceiling that is only a number: slabs and suspended ceilings lie between."""

TOUCHING, THIN = 0.02, 0.5
"""Metres from a wall to what hangs on it, if it is thicker than this part of its width: wall
cupboards touch, and brackets are seldom behind anything but screens, pictures and hoods."""

PICTURE = 0.1
"""Part of its width as thick as which a picture is at most: names are no proof of a cup."""

HUNG = 0.15
"""Metres of air between a ceiling and what hangs at it: hooks and short cables."""

UNSHAPED = 1.0
"""Metres beside the place of an object without geometry that it may cover."""

SLAB, TALL = 0.5, 1.8
"""Metres: parts of a building are flatter or taller than that, and span rooms."""

STEP = 0.5
"""Metres of height by which a floor may differ from its storey, its doors from it: a few steps."""

RAISED = 0.2
"""Metres: what stands on a floor is a raised floor up to this height."""

LINTEL = 1.5
"""Metres above a floor from which nothing is in the way of a robot of which nothing is known."""

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
        self.is_part = cache(self._is_part)

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
                share = common(ground, room.outline).area / area if area else 1.0
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
        whole = united(room.outline for room in self.rooms)
        whole = whole.buffer(WALL, join_style="mitre").buffer(-WALL, join_style="mitre")
        return united(shapely.Polygon(p.exterior) for p in shapely.get_parts(whole))

    def _is_part(self, entity: CheckedEntity) -> bool:
        """Whether an object is a part of the building: by its type, else by shape and place.

        It is flat or tall and over half of a room, tall ones with what they are around; or tall,
        thin and between rooms.
        """
        if entity.row["structure"]:
            return True
        if entity.outline is None:
            return False
        height = (entity.high - entity.low)[2]
        if SLAB < height < TALL:
            return False
        around = entity.outline.minimum_rotated_rectangle
        over = around if height > SLAB else entity.outline
        if over.area >= 1:
            for number in self.room_tree.query(over, predicate="intersects"):
                room = self.rooms[number]
                above = entity.low[2] - self.floor(room)
                if abs(above) <= CONTACT and RAISED < height <= SLAB:
                    continue  # furniture in a small room
                if above < -height - SLAB or entity.low[2] > self.ceiling(room) + SLAB:
                    continue  # it is on another storey
                if common(over, room.ground).area >= room.ground.area / 2:
                    return True
        if height < TALL or not self.rooms:
            return False
        sides = shapely.get_coordinates(around)
        thin = min(np.linalg.norm(np.diff(sides[:3], axis=0), axis=1), default=0) <= WALL
        return bool(thin) and sum(self.shares(entity).values()) < 0.5

    @cached_property
    def one_point(self) -> list[list[CheckedEntity]]:
        """The groups of movable things at one point, or of one size and within a contact."""
        movable = [e for e in self.objects if not self.is_part(e)]
        stands = np.array([e.stand for e in movable]).reshape(-1, 3)
        sizes = np.array([e.high - e.low for e in movable]).reshape(-1, 3)
        cells = np.round(np.hstack([stands, sizes]) / SAME_POINT / 2)
        _, first, same = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        same = same.ravel()  # in some versions of NumPy it has the shape of the cells
        pairs = KDTree(stands[first]).query_pairs(2 * CONTACT, output_type="ndarray")
        pairs = np.array(
            [pair for pair in pairs if _coincide(*(movable[first[k]] for k in pair))], int
        ).reshape(-1, 2)
        links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(first),) * 2)
        group = connected_components(links, directed=False)[1][same]
        found: dict[int, list[CheckedEntity]] = {}
        for entity, number in zip(movable, group, strict=True):
            found.setdefault(int(number), []).append(entity)
        return [together for together in found.values() if len(together) > 1]

    @cached_property
    def together(self) -> dict[str, int]:
        """The number of the group at one point of each thing that is in one."""
        return {e.name: number for number, group in enumerate(self.one_point) for e in group}

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

    def drawn_rooms(self, door: CheckedEntity) -> dict[str, CheckedEntity]:
        """The rooms with an outline that a door joins, by its ends a and b."""
        rooms = {end: self.by_id.get(door.row[f"place_{end}"]) for end in "ab"}
        return {end: r for end, r in rooms.items() if r and r.kind == "room" and r.outline}

    def at_opening(self, door: Pose, width: float) -> list[CheckedEntity]:
        """The solids at an opening, as thick as walls may be."""
        half = width / 2
        corners = door.apply([[x, y, 0] for x in (-WALL, WALL) for y in (-half, half)])
        around = shapely.MultiPoint(corners[:, :2]).convex_hull
        found = (self.solids[n] for n in np.sort(self._solid_tree.query(around)))
        return [e for e in found if e.low[2] <= door.z + LINTEL + SAME_POINT and e.high[2] > door.z]

    def over(self, ground: shapely.Geometry) -> list[CheckedEntity]:
        """The solids whose outlines share area with a ground, at any height."""
        found = (self.solids[n] for n in np.sort(self._solid_tree.query(ground)))
        return [e for e in found if common(e.ground, ground).area > 0]

    def beneath(self, entity: CheckedEntity) -> list[CheckedEntity]:
        """Other solids over which an object is, wholly or in part; the highest first."""
        around = shapely.box(*entity.low[:2], *entity.high[:2])
        found = [self.solids[n] for n in self._solid_tree.query(around)]
        below = [e for e in found if e is not entity and e.low[2] < entity.low[2] + CONTACT]
        return sorted(below, key=lambda e: -float(min(e.high[2], entity.low[2])))


def _coincide(one: CheckedEntity, two: CheckedEntity) -> bool:
    """Whether things share a point and space, or a size and are as close as copies of one."""
    apart = np.abs(one.stand - two.stand)
    if apart.max() <= SAME_POINT:
        return _share_space(one, two)
    sizes = one.high - one.low, two.high - two.low
    alike = np.abs(sizes[0] - sizes[1]) <= TWINS * np.maximum(*sizes)
    near = apart <= np.array([CONTACT, CONTACT, min(STACKED, sizes[0][2] / 2)]) + 1e-6
    shaped = len(one.triangles) and len(two.triangles)
    return bool(shaped and alike.all() and near.all() and _share_space(one, two))


def _share_space(one: CheckedEntity, two: CheckedEntity) -> bool:
    """Whether two things at a point are in each other, and not above or around each other."""
    if not (len(one.triangles) and len(two.triangles)):
        return True  # nothing says that they are not
    depth, part = shared_columns(one.triangles, two.triangles)
    return part >= MOST_OF_IT or (part >= SOME_OF_IT and depth > CONTACT)
