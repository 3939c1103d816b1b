"""How and where an object of the map is put down: stored places before generated ones.

A place belongs to a model and a gripper, as the grasp that it ends: the gripper and its joints are
those of the grasp, and its way back is that of the grasp reversed (Tosello et al., section III-A).
The spot on the support is found each time, since it depends on the objects there.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.arrays import Floats
from semmap.finite_number import finite_numbers
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import ANY_LEVEL, LevelPatch, Levels
from semmap.manipulation.action_record import ActionRecord
from semmap.manipulation.arm import Arm
from semmap.manipulation.automata import WAY, Reach, facing_first, reachable_rows
from semmap.manipulation.candidates import Grasps
from semmap.manipulation.collision import Obstacles, free_places, free_way
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.found_actions import FoundActions
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.placing import ABOVE, PlacePose, covered, place_candidates, stability
from semmap.manipulation.ranking import ranked
from semmap.manipulation.reader import STORED, actions_on, in_model
from semmap.manipulation.retrieval import find_grasps, gripper_name, stored_gripper
from semmap.manipulation.stances import Stances, ground_of
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.store.model_shapes import model_mesh, shape_of
from semmap.manipulation.surroundings import entity_triangles, is_shut, obstacles_around
from semmap.query.entity_query import entity_id
from semmap.query.snapshot import Snapshot

LIFT = 0.1
"""Metres from which an object is moved straight down."""

GRASPS = 24
"""Grasps of an object for which places are generated at once."""

SPOTS = 400
"""Poses on the support at which the gripper is checked."""

REACHED = 150
"""Places whose reach by an arm is computed, at most."""

AT_SPOT = 6
"""Places at one spot whose reach is computed."""

RING = 0.1
"""Metres of distance from a base within which spots are tried in any order."""

UPRIGHT = np.cos(np.radians(5))
"""Of a stored place whose way down differs by less from the vertical."""


FEW_GRASPS, FEW_SPOTS = 24, 100
"""Grasps and spots at which it is asked whether a hand gets inside of something."""


class PutDowns:
    """Where an object can be put down on another one; both and what is around are read once.

    ManipulationError where one of them has no mesh.
    """

    def __init__(
        self, seen: Snapshot, entity: str, on: str, gripper: Gripper, levels: Levels = ANY_LEVEL
    ) -> None:
        self.seen, self.entity, self.on, self.gripper = seen, entity, on, gripper
        self.vertices = np.asarray(model_mesh(seen, entity).vertices)
        self.upright = _upright(seen, entity_id(seen.session, entity))
        self._triangles = entity_triangles(seen, on)
        self.surfaces = levels.of(Mesh.of_triangles(self._triangles))
        self._last: tuple[Any, Any, _FreePlaces] | None = None  # of the same places and spots

    @cached_property
    def _obstacles(self) -> Obstacles:
        return obstacles_around(self.seen, self.on, without=self.entity)

    @cached_property
    def _spots(self) -> list[PlacePose]:
        return self._candidates()

    def _candidates(self, at: Sequence[Floats] | None = None) -> list[PlacePose]:
        """The free spots, without those inside of what is shut."""
        around = self._obstacles.triangles
        if at is None:
            spots = [*_free_spots(_Support.of(self.vertices, self.upright, self.surfaces, around))]
        else:
            spots = place_candidates(self.vertices, self.upright, self.surfaces, around, at=at)
        if not is_shut(self.seen, self.on):
            return spots
        inside = covered(spots, self.surfaces, self._triangles)
        return [spot for spot in spots if spot not in inside]

    def ends_of(self, grasps: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        """Places that end some grasps (`known_grasps`); they are not stored."""
        ways = []
        for row in grasps[:: max(1, len(grasps) // FEW_GRASPS)]:
            before = in_model(row, "pose")
            before[:3, 3] += LIFT * self.upright[2, :3]
            after = Pose.from_matrix(in_model(row, "pre_pose"))
            there = {"pose": row["model_pose"], "post_pose": after}
            ways.append(row | there | {"pre_pose": Pose.from_matrix(before)})
        return ways

    def ways(self, places: Sequence[dict[str, Any]], most: int) -> list[dict[str, Any]]:
        """Some places at some free spots, by chance, whether or not the gripper is free there."""
        number = len(self._spots) * len(places)
        chosen = np.random.default_rng(0).choice(number, min(number, most), replace=False)
        spots, ends = np.divmod(chosen, max(1, len(places)))
        rows = [
            _row(places[j], self._spots[i]) | {"at": self._spots[i]}
            for i, j in zip(spots, ends, strict=True)
        ]
        return [row | {"on": self.on} for row in rows]

    def is_free(self, places: Sequence[dict[str, Any]], way: dict[str, Any]) -> bool:
        """Whether the gripper is free along one of the `ways` of some places."""
        free = self._free(places, self._spots).at(way["at"])
        return any(row["model_pose"] is way["model_pose"] for row in free)

    def some_are_free(self, places: Sequence[dict[str, Any]]) -> bool:
        """Whether the gripper does one of some places at one of a few spots."""
        spots = self._spots[:: max(1, len(self._spots) // FEW_SPOTS)]
        free = self._free(places, spots)
        return any(free.at(spot) for spot in spots)

    def rows(
        self,
        places: Sequence[dict[str, Any]],
        limit: int,
        *,
        towards: Sequence[float] | None = None,
        arm: Arm | None = None,
        base: Pose | None = None,
        most: int = REACHED,
    ) -> tuple[list[dict[str, Any]], str | None]:
        """The free ones of some places, one at each spot; why there is none.

        Parameters are those of `find_places`; the reach of an arm is asked for `most` places.
        """
        spots = self._spots
        if arm is not None and base is not None and arm.needs_base:
            heights = [surface.height for surface in self.surfaces]
            at = _spots_of_arm(places, self.vertices, self.upright, heights, arm, base)
            spots = self._candidates(at)
            if not spots:
                where = f"({base.x:g}, {base.y:g})"
                return [], f"{self.on}: the arm at {where} puts {self.entity} on no free part of it"
        if not spots:
            return [], f"{self.on}: none of its surfaces has room for {self.entity}"
        free = self._free(places, spots)
        ordered = _in_order(spots, towards)
        if towards is None and arm is not None and base is not None:
            ordered = _in_order(spots, base[:2], room=1.0, away=arm.usual_reach)
        ordered.sort(key=lambda spot: spot in free.inside)  # on it before inside of it
        rows = free.first(ordered, limit, arm, base, most)
        why = None if rows else free.problem(self.entity, self.on, base)
        return [row | {"on": self.on} for row in rows], why

    def _free(self, places: Sequence[dict[str, Any]], spots: Sequence[PlacePose]) -> _FreePlaces:
        if self._last is None or self._last[0] is not places or self._last[1] is not spots:
            corners = self._triangles.reshape(-1, 3)
            box = corners.min(axis=0), corners.max(axis=0)
            inside = covered(spots, self.surfaces, self._triangles)
            around, vertices = self._obstacles, self.vertices
            free = _FreePlaces(places, self.gripper, around, vertices, inside, box)
            self._last = places, spots, free
        return self._last[2]


@dataclass(frozen=True)
class _Support:
    """What the free spots for an object depend on, and its digest, which tells two apart."""

    digest: bytes
    vertices: Floats = field(compare=False)
    upright: Floats = field(compare=False)
    surfaces: Sequence[LevelPatch] = field(compare=False)
    around: Floats = field(compare=False)

    @classmethod
    def of(
        cls, vertices: Floats, upright: Floats, surfaces: Sequence[LevelPatch], around: Floats
    ) -> _Support:
        digest = hashlib.sha256()
        for array in (vertices, upright, around):
            digest.update(np.ascontiguousarray(array).data)
        for surface in surfaces:
            digest.update(surface.outline.wkb + np.float64(surface.height).tobytes())
        return cls(digest.digest(), vertices, upright, surfaces, around)


@lru_cache(maxsize=16)
def _free_spots(on: _Support) -> list[PlacePose]:
    """The free spots, kept: plans and missions ask for them again and again."""
    return place_candidates(on.vertices, on.upright, on.surfaces, on.around)


def find_places(
    seen: Snapshot,
    entity: str,
    on: str,
    *,
    gripper: str | None = None,
    grasps: Sequence[int] | None = None,
    towards: Sequence[float] | None = None,
    arm: Arm | None = None,
    base: Pose | None = None,
    limit: int = 10,
    levels: Levels = ANY_LEVEL,
) -> FoundActions:
    """The best places of an object on another one; they are generated where none is stored.

    The object stands as it does now, or as it did before a robot took it, turned about the
    vertical. Gripper and object touch nothing on the way down, the open gripper nothing on its way
    back. Spots on top come before those inside of the support, such as on a lower board; there, the
    hand with the object must come in straight from outside.

    `grasps` are ids of those that may hold it, by default the one with which an agent of the map
    took it, else the best ones. Spots near `towards` (x, y) come first, else those with most room;
    they are on the `levels` of the support. With an arm of this gripper whose robot stands at
    `base`, map's frame, only places that it reaches. Rows are those of `actions_on`, the poses of
    the gripper for the object at its spot, each another one; also `on`, `spot` (the pose of the
    object, map's frame), `clearance` (metres), `grasp_id` and `grasp_expected` of the grasp that it
    ends; with an arm, `position` of its joints where the way down begins.

    LookupError without the entity, gripper or grasp; ManipulationError where one has no mesh, or
    nothing can stand on the support.
    """
    item = entity_id(seen.session, entity)
    if towards is not None and finite_numbers(towards, 2) is None:
        raise ManipulationError(f"{entity}: {towards} is not a point: give x, y in metres")
    if item == entity_id(seen.session, on):
        raise ManipulationError(f"{entity}: cannot be put on itself: name another object")
    chosen = gripper_name(seen.session, gripper)
    puts = PutDowns(seen, entity, on, stored_gripper(seen.session, chosen), levels)
    if not puts.surfaces and ANY_LEVEL.of(Mesh.of_triangles(entity_triangles(seen, on))):
        return FoundActions([], [f"{on}: no level of it is within reach"])
    if not puts.surfaces:
        raise ManipulationError(
            f"{on}: has no level surface on which an object can stand: name another object"
        )
    held, problems = _grasps(seen, entity, chosen, grasps)
    places, generated = _places(seen, entity, chosen, held, puts.vertices, puts.upright)
    if not places:
        return FoundActions([], problems or [f"{entity}: gripper {chosen} has no grasp of it"])
    rows, why = puts.rows(places, limit, towards=towards, arm=arm, base=base)
    if why is not None:
        problems.append(why)
    if towards is None:
        rows = sorted(rows, key=_doubt)
    return FoundActions(rows, problems, generated)


def _spots_of_arm(
    places: Sequence[dict[str, Any]],
    vertices: Floats,
    upright: Floats,
    heights: Sequence[float],
    arm: Arm,
    base: Pose,
) -> list[Floats]:
    """For each height, (M, 3) x, y and turn of an object as some arm puts it down from a base.

    Such an arm has too few joints to get to a spot that is given.
    """
    stances, found = Stances(arm), []
    lowest = float((vertices @ upright[:3, :3].T)[:, 2].min())
    for height in heights:
        stands = upright.copy()
        stands[:3, 3] = 0.0, 0.0, height + ABOVE - lowest
        spots = []
        for row in places:
            way = [stands @ in_model(row, key) for key in WAY if row.get(key) is not None]
            back = np.linalg.inv(ground_of(way[0], base.z))
            for ground in stances.grounds(way, base.z):
                pose = base.matrix @ ground @ back
                spots.append((*pose[:2, 3], math.atan2(pose[1, 0], pose[0, 0])))
        found.append(np.array(spots).reshape(-1, 3))
    return found


def place_of(seen: Snapshot, entity: str, grasp: int, gripper: str | None = None) -> int | None:
    """The id of the best stored place of an object that a grasp holds; None without one."""
    chosen = gripper_name(seen.session, gripper)
    grasps, _ = _grasps(seen, entity, chosen, [grasp])
    up = _upright(seen, entity_id(seen.session, entity))[2, :3]
    rows = _stored(seen, entity, chosen, grasps, up)
    return int(rows[0]["action_id"]) if rows else None


def _upright(seen: Snapshot, item: int) -> Floats:
    """The pose (4, 4) in which an object stands, or stood before a robot took it."""
    row = seen.session.execute(STANDS, {"item": item}).fetchone()
    if row is None or row[0] is None:
        raise ManipulationError("the object has no pose in the map: semmap put gives it one")
    return Pose(*row[0]).matrix


STANDS = """
SELECT coalesce((SELECT t.start FROM placement p JOIN entity h ON h.id = p.holder_id
                 JOIN task t ON t.entity_id = p.entity_id AND t.robot_id = h.id
                            AND t.kind = 'grasp' AND t.outcome = 'completed'
                 WHERE p.entity_id = %(item)s AND h.kind = 'agent' ORDER BY t.id DESC LIMIT 1),
                (SELECT w.pose FROM world w WHERE w.entity_id = %(item)s))
"""


def taken_by(seen: Snapshot, entity: str, gripper: str) -> int | None:
    """The id of the grasp by which an agent of the map holds an object; None without one."""
    row = seen.session.execute(TAKEN, (entity, gripper)).fetchone()
    return None if row is None else int(row[0])


TAKEN = """
SELECT t.action_id FROM placement p JOIN entity h ON h.id = p.holder_id AND h.kind = 'agent'
JOIN task t ON t.entity_id = p.entity_id AND t.robot_id = h.id
           AND t.kind = 'grasp' AND t.outcome = 'completed'
JOIN action a ON a.id = t.action_id AND a.replaced_by IS NULL
WHERE p.entity_id = entity_id(%s) AND a.gripper_id = gripper_named(%s) ORDER BY t.id DESC LIMIT 1
"""


def _grasps(
    seen: Snapshot, entity: str, gripper: str, chosen: Sequence[int] | None
) -> tuple[list[dict[str, Any]], list[str]]:
    """The grasps, as rows, that a place can end; and why there is none."""
    if chosen is None and (taken := taken_by(seen, entity, gripper)) is not None:
        chosen = [taken]
    if chosen is None:
        found = find_grasps(seen, name=entity, gripper=gripper, limit=GRASPS)
        return found.rows, found.problems
    rows = actions_on(seen, name=entity, gripper=gripper, limit=STORED)
    held = ranked(seen.session, [row for row in rows if row["action_id"] in chosen], gripper)
    if not held:
        ids = ", ".join(map(str, chosen))
        raise LookupError(f"{entity}: there is no grasp {ids} of it by gripper {gripper}")
    return held, []


def _places(
    seen: Snapshot,
    entity: str,
    gripper: str,
    grasps: Sequence[dict[str, Any]],
    vertices: Floats,
    upright: Floats,
) -> tuple[list[dict[str, Any]], list[str]]:
    """The stored places that end some grasps, the best first, and for which some were generated."""
    up = upright[2, :3]
    stored = _stored(seen, entity, gripper, grasps, up)
    ended = np.array([row["model_pose"].matrix for row in stored]).reshape(-1, 4, 4)
    missing = [row for row in grasps if not _alike(ended, row["model_pose"].matrix).any()]
    if not missing:
        return stored, []
    shape = shape_of(seen, entity)
    side = _side(shape.kind, shape.pose[:3, :3].T @ up)
    firm = stability(vertices, upright)
    records = []
    for row in missing:
        pose = row["model_pose"].matrix
        before = pose.copy()
        before[:3, 3] += LIFT * up
        family = f"{row['family'] or row['approach'] or 'grasp'}, {side}"
        records.append(
            ActionRecord(
                "place",
                row["model_pose"],
                pre_pose=Pose.from_matrix(before),
                post_pose=Pose.from_matrix(in_model(row, "pre_pose")),
                approach=row["approach"],
                family=family,
                width=row["width"],
                posture=row["posture"],
                pre_posture=row["pre_posture"],
                quality=firm,
            )
        )
    add_actions(seen.session, entity, gripper, records)
    return _stored(seen, entity, gripper, grasps, up), [entity]


def _stored(
    seen: Snapshot, entity: str, gripper: str, grasps: Sequence[dict[str, Any]], up: Floats
) -> list[dict[str, Any]]:
    """The stored places of an object that stands on this side and is held by one of the grasps."""
    rows = actions_on(seen, name=entity, gripper=gripper, kind="place", limit=STORED)
    rows = ranked(seen.session, rows, gripper, "place")
    held = np.array([row["model_pose"].matrix for row in grasps]).reshape(-1, 4, 4)
    found = []
    for row in rows:
        pose = row["model_pose"].matrix
        way = (in_model(row, "pre_pose") - pose)[:3, 3]
        if way @ up < UPRIGHT * max(float(np.linalg.norm(way)), 1e-9):
            continue
        same = np.flatnonzero(_alike(held, pose))
        if len(same):
            grasp = grasps[same[0]]
            ids = {"grasp_id": grasp["action_id"], "grasp_expected": grasp["expected"]}
            found.append(row | ids)
    return sorted(found, key=_doubt)


def _alike(poses: Floats, pose: Floats) -> NDArray[np.bool_]:
    """(N,) whether poses (N, 4, 4) equal another one."""
    same: NDArray[np.bool_] = np.abs(poses - pose).max(axis=(1, 2)) < 1e-4
    return same


def _side(kind: str, up: Floats) -> str:
    """Which side of a shape is up, such as ``+z up``; a direction across a round one is r."""
    axis = int(np.argmax(np.abs(up).round(6)))
    if kind == "sphere":
        return "any up"
    if kind in ("cylinder", "cone") and axis < 2:
        return "r up"
    return f"{'+' if up[axis] > 0 else '-'}{'xyz'[axis]} up"


class _FreePlaces:
    """The places where the gripper is free; spots `inside` are below parts of the `box`."""

    def __init__(
        self,
        places: Sequence[dict[str, Any]],
        gripper: Gripper,
        obstacles: Obstacles,
        vertices: Floats,
        inside: frozenset[PlacePose],
        box: tuple[Floats, Floats],
    ) -> None:
        self.inside, self.box = inside, box
        self.places, self.obstacles, self.vertices = places, obstacles, vertices
        poses = np.array([row["model_pose"].matrix for row in places])
        after = np.array([in_model(row, "post_pose") for row in places])
        self.ways = Grasps.of_rows(gripper, places, poses, after)
        self.before = np.array([in_model(row, "pre_pose") for row in places])
        self.near = self.met = 0
        self._known: dict[PlacePose, list[dict[str, Any]]] = {}
        self._reach: Reach | None = None

    def at(self, spot: PlacePose) -> list[dict[str, Any]]:
        """The rows of the free places at a spot, the best first."""
        if spot not in self._known:
            self._known[spot] = self._at(spot)
        return self._known[spot]

    def _at(self, spot: PlacePose) -> list[dict[str, Any]]:
        free = free_places(self.ways, self.before, spot.pose, self.obstacles, self.vertices)
        if spot in self.inside:
            for i in np.flatnonzero(free):
                free[i] = self._gets_in(int(i), spot)
        return [_row(self.places[int(i)], spot) for i in np.flatnonzero(free)]

    def _gets_in(self, number: int, spot: PlacePose) -> bool:
        """Whether hand and object come straight from outside of the support, and the hand back."""
        before, after = spot.pose @ self.before[number], spot.pose @ self.ways.pre_grasps[number]
        held = np.linalg.inv(self.ways.poses[number])  # the object in the frame of the gripper
        width = float(self.ways.widths[number])
        gripper, box = self.ways.gripper, self.box
        return free_way(gripper, width, before, box, self.obstacles, self.vertices, held) and (
            free_way(gripper, gripper.opening, after, box, self.obstacles)
        )

    def first(
        self,
        spots: Sequence[PlacePose],
        limit: int,
        arm: Arm | None = None,
        base: Pose | None = None,
        most: int = REACHED,
    ) -> list[dict[str, Any]]:
        """For each spot, the first free place, or the first one that an arm reaches."""
        if arm is not None and (self._reach is None or self._reach.arm is not arm):
            self._reach = Reach(arm)
        self.near = self.met = 0
        found: dict[tuple[float, ...], dict[str, Any]] = {}
        for spot in spots:
            if spot.spot in found or self._is_far(spot, arm, base):
                continue
            self.near += 1
            some = self.at(spot)
            if arm is not None and base is not None:
                some = facing_first(some, base)[:AT_SPOT]
                self.met += len(some)
                some = reachable_rows(some, arm, base, 1, self._reach)
            if some:
                found[spot.spot] = some[0]
            if len(found) == limit or self.near == SPOTS or self.met >= most:
                break
        return list(found.values())

    def _is_far(self, spot: PlacePose, arm: Arm | None, base: Pose | None) -> bool:
        """Whether a spot is beyond the stretched arm, whatever the grasp."""
        if arm is None or base is None:
            return False
        there = np.linalg.inv(base.matrix) @ spot.pose
        points = self.ways.poses[:, :3, 3] @ there[:3, :3].T + there[:3, 3]
        return bool(arm.is_far(points).all())

    def problem(self, entity: str, on: str, base: Pose | None) -> str:
        """Why no place was found."""
        room = f"{on}: has room for {entity}, but"
        if base is not None and not self.near:
            return f"{room} all of it is beyond the arm at ({base.x:g}, {base.y:g})"
        if base is not None and self.met:
            reaches = f"the arm at ({base.x:g}, {base.y:g}) reaches none of"
            return f"{room} {reaches} {self.met} places where the gripper is free"
        number = len(self.places)
        return f"{room} the gripper touches what is around at all {number} places"


def _doubt(row: dict[str, Any]) -> float:
    """Orders places by the expected share of successes of the grasp and the place."""
    return -float(row["expected"] * row["grasp_expected"])


def _in_order(
    spots: Sequence[PlacePose],
    towards: Sequence[float] | None,
    room: float = 0.5,
    away: float = 0.0,
) -> list[PlacePose]:
    """The spots with most room first; else, of those with enough, the nearest to a point first.

    With `away`, those come first that are nearest to that distance from it; of those about as near,
    the order is by chance, so that the first few differ in side and heading.
    """
    if towards is None:
        return list(spots)
    point = np.asarray(towards, dtype=float)[:2]
    gap = {s: abs(float(np.linalg.norm(s.pose[:2, 3] - point)) - away) for s in spots}
    if not away:
        return sorted(spots, key=lambda s: (s.quality < room, gap[s]))
    chance = dict(zip(spots, np.random.default_rng(0).random(len(spots)).tolist(), strict=True))
    return sorted(spots, key=lambda s: (s.quality < room, gap[s] // RING, chance[s]))


def _row(place: dict[str, Any], spot: PlacePose) -> dict[str, Any]:
    """A place at a spot: its poses in the map's frame."""
    row = place | {"spot": Pose.from_matrix(spot.pose), "clearance": spot.clearance}
    for key in ("pose", "pre_pose", "post_pose"):
        row[key] = Pose.from_matrix(spot.pose @ in_model(place, key))
    return row
