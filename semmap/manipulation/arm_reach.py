"""Whether a robot's arm could act on objects of the map from where its base might stand.

Plans ask before missions try; so nothing is stored, and whether the arm gets from how it is carried
to where an action begins is left to the mission.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Sequence
from functools import cached_property
from itertools import islice, product
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import LevelPatch, support_surfaces
from semmap.manipulation.arm import Arm
from semmap.manipulation.arm_motions import FreeArm
from semmap.manipulation.automata import (
    STARTS,
    Reach,
    cost_of,
    facing_first,
    quickest_first,
    way_of,
)
from semmap.manipulation.places import PutDowns
from semmap.manipulation.placing import spots_on
from semmap.manipulation.stances import Stances
from semmap.manipulation.surroundings import Surroundings, entity_triangles
from semmap.query.snapshot import Snapshot

ABOVE = (0.05, 0.2)
"""Metres above a surface at which the gripper lets go of what it puts down: of low or high grasps.
"""

FEW = 4
"""Grasps within reach of which one is often free; else it is asked which ones are."""

MET, PLACES, REACHED = 12, 3, 24
"""Grasps and places within reach of a base of which it is asked whether the arm touches something,
and places of which it is asked whether they are within reach."""

ASKED = 48
"""Grasps, some of each family, of which it is asked whether they are within reach of a base: where
none is, that takes longest."""

SPACING = 0.1
"""Metres between the spots of a surface that are tried."""

SPOTS = 3
"""Spots of each level of a surface that are tried, the nearest to the base."""

DOWN, TURN = (180.0, 135.0, 90.0), (0.0, 90.0)
"""Degrees of the ways in which the gripper puts something down: it points down, slanting or ahead,
and is turned about its own axis."""

WAYS, FEW_WAYS = 96, 24
"""Grasps along which bases are sought: of an arm with few joints, ways at many grasps are alike."""

TURNS = 16
"""Headings of the gripper over each spot."""

PUTS = 800
"""Ways down onto a surface along which bases are sought."""

INSIDE = 0.1
"""Metres from the edge of a surface at which they are, if there are any."""

LIFT = 0.1
"""Metres of the way down, and of the way back."""


class ArmReach(ABC):
    """From which bases an arm acts on an object; poses are in the map's frame.

    A base costs as much as the action that costs least from there (`automata.cost_of`).
    """

    def __init__(self, arm: Arm) -> None:
        self.arm, self._reach, self._stances = arm, Reach(arm), Stances(arm)

    @abstractmethod
    def cost(self, base: Pose) -> float | None:
        """What it costs from a base; None if the arm does not act on the object from there."""

    @abstractmethod
    def actions(self) -> Sequence[dict[str, Any]]:
        """Actions on the object, with poses as those of `actions_on`."""

    def stances(self, floor: float) -> tuple[Floats, NDArray[np.intp]]:
        """(N, 3) x, y and yaw of bases from which some actions are done, and (N,) which ones.

        Whether the arm gets there from exactly there is left to `cost_of`.
        """
        return self._stances.bases([way_of(row) for row in self.actions()], floor)

    def cost_of(self, number: int, base: Pose) -> float | None:
        """What one of `actions` costs from a base; None if the arm does not get along it."""
        position = self._reach.along(self.actions()[number], base)
        return None if position is None else cost_of(self.actions()[number], self.arm, position)

    @property
    def side(self) -> str:
        """To which side of the robot the arm reaches."""
        x, y = self.arm.reaches_towards
        sides = {"ahead": x, "behind": -x, "to its left": y, "to its right": -y}
        return max(sides, key=lambda side: sides[side])


class GraspReach(ArmReach):
    """From which bases an arm takes an object by one of its grasps (`known_grasps`).

    Only those count at which gripper and arm are free of what is around, unless the gripper touches
    something at all, or the object is `beneath` others, which are taken off before.
    """

    def __init__(
        self, seen: Snapshot, rows: Sequence[dict[str, Any]], arm: Arm, *, beneath: bool = False
    ) -> None:
        super().__init__(arm)
        self._rows = [row for row in rows if arm.gripper.can_tilt_to(row["pose"].matrix)]
        self._around, self._beneath = Surroundings(seen, arm.gripper), beneath
        self._arm_around = FreeArm(seen, arm)

    @cached_property
    def _hand_free(self) -> list[dict[str, Any]]:
        return [] if self._beneath else self._around.free_rows(self._rows)

    @cached_property
    def _some(self) -> list[dict[str, Any]]:
        rows = _by_turns(self._hand_free or self._rows)
        return rows[: WAYS if self.arm.needs_base else FEW_WAYS]

    def actions(self) -> Sequence[dict[str, Any]]:
        """The free grasps, some of each family."""
        return self._some

    def cost_of(self, number: int, base: Pose) -> float | None:
        """What one of `actions` costs; None if the arm does not get along it, or touches."""
        cost = super().cost_of(number, base)
        if cost is None or not self._hand_free:
            return cost
        return cost if self._arm_around.one(base, [self.actions()[number]]) else None

    def cost(self, base: Pose) -> float | None:
        """What taking the object costs from a base; None if the arm does not take it."""
        first = self._reached(self._rows, base, FEW)
        if not first or self._beneath:
            return first[0]["cost"] if first else None
        free = [row for row, each in zip(first, self._around.free(first), strict=True) if each]
        taken = self._arm_around.one(base, free)
        if taken is None and self._hand_free:
            taken = self._arm_around.one(base, self._reached(self._hand_free, base, MET))
            return None if taken is None else float(taken["cost"])
        return float((taken or first[0])["cost"])

    def _reached(
        self, some: Sequence[dict[str, Any]], base: Pose, most: int
    ) -> list[dict[str, Any]]:
        """Some grasps that the arm reaches from a base, with their `cost`, the least first."""
        turns = _by_turns(facing_first(some, base))[:ASKED]
        every = ((row, self._reach.along(row, base)) for row in turns)
        reached = ((row, position) for row, position in every if position is not None)
        found = [row | {"cost": cost_of(row, self.arm, at)} for row, at in islice(reached, most)]
        return sorted(found, key=lambda row: float(row["cost"]))


def _by_turns(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The first grasp of each family, then the second ones, and so on: those alike fail alike."""
    count: Counter[str | None] = Counter()
    turns = []
    for row in rows:
        turns.append(count[row["family"]])
        count[row["family"]] += 1
    return [rows[i] for i in np.argsort(turns, kind="stable")]


class PutReach(ArmReach):
    """From which bases an arm puts one of some objects down on another one.

    Each is put down after one of its grasps; hand, object and arm are free of what is around.
    """

    def __init__(
        self, seen: Snapshot, puts: Sequence[tuple[PutDowns, list[dict[str, Any]]]], arm: Arm
    ) -> None:
        super().__init__(arm)
        self._puts = [(there, there.ends_of(self._tilted(there, rows))) for there, rows in puts]
        self._arm_around = FreeArm(seen, arm)

    def _tilted(self, there: PutDowns, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The grasps in whose tilt the gripper is where the object stands."""
        can_tilt_to = self.arm.gripper.can_tilt_to
        return [row for row in rows if can_tilt_to(there.upright @ row["model_pose"].matrix)]

    def actions(self) -> Sequence[dict[str, Any]]:
        """Ways of the hand down onto some spots."""
        return self._ways

    @cached_property
    def _ways(self) -> list[dict[str, Any]]:
        return [way | {"put": put} for put in self._puts for way in put[0].ways(put[1], PUTS)]

    def cost_of(self, number: int, base: Pose) -> float | None:
        """What one of `actions` costs; None if the arm does not get along it, or touches."""
        way = self.actions()[number]
        there, ends = way["put"]
        cost = super().cost_of(number, base)
        if cost is None or not there.is_free(ends, way):
            return None
        return cost if self._arm_around.one(base, [way]) else None

    def cost(self, base: Pose) -> float | None:
        """What putting one of the objects down costs; None if the arm puts none down."""
        for there, ends in self._puts:
            rows, _ = there.rows(ends, PLACES, arm=self.arm, base=base, most=REACHED)
            put = self._arm_around.one(base, quickest_first(rows, self.arm))
            if put is not None:
                return cost_of(put, self.arm, self.arm.position(put["position"]))
        return None


class SurfaceReach(ArmReach):
    """From which bases an arm brings its gripper over the surfaces `levels` of an object."""

    def __init__(self, levels: Sequence[LevelPatch], arm: Arm) -> None:
        super().__init__(arm)
        self._surfaces = levels
        self._levels = [_spots(level) for level in levels]

    @classmethod
    def on(cls, seen: Snapshot, entity: str, arm: Arm) -> SurfaceReach | None:
        """Of an object of the map; None without a surface."""
        levels = support_surfaces(Mesh.of_triangles(entity_triangles(seen, entity)))
        return cls(levels, arm) if levels else None

    def actions(self) -> Sequence[dict[str, Any]]:
        """Ways down onto the surfaces, and back."""
        return self._ways

    @cached_property
    def _ways(self) -> list[dict[str, Any]]:
        inner = [_spots(level, inside=INSIDE) for level in self._surfaces]
        return [row for spots in inner for row in _put_downs(spots, self.arm)]

    def cost(self, base: Pose) -> float | None:
        """What it costs to get over a spot near a base; None if the arm gets over none."""
        for level in self._levels:
            spots = base.inverse().apply(level)
            nearest = np.argsort(np.linalg.norm(spots[:, :2], axis=1), kind="stable")[:SPOTS]
            for spot in spots[nearest]:
                position = _reaches_over(self.arm, spot)
                if position is not None:
                    return cost_of({}, self.arm, position)
        return None


def _put_downs(spots: Floats, arm: Arm) -> list[dict[str, Any]]:
    """Ways of the gripper to spots (N, 3), from above and then back along its approach."""
    ways = list(product(spots, 2 * np.pi / TURNS * np.arange(TURNS), _tilts(arm), ABOVE))
    if len(ways) > PUTS:
        chosen = np.random.default_rng(0).choice(len(ways), PUTS, replace=False)
        ways = [ways[i] for i in chosen]
    found = []
    for spot, heading, tilt, above in ways:
        pose, up, back = Pose.planar(spot[0], spot[1], heading).matrix @ tilt, np.eye(4), np.eye(4)
        pose[2, 3] = spot[2] + above
        up[2, 3], back[2, 3] = LIFT, -LIFT
        there = {"pre_pose": up @ pose, "pose": pose, "post_pose": pose @ back}
        found.append({key: Pose.from_matrix(each) for key, each in there.items()})
    return found


def _tilts(arm: Arm) -> list[Floats]:
    """Poses (4, 4) of the gripper that differ by more than a turn about the vertical."""
    tilts = np.tile(np.eye(4), (len(DOWN) * len(TURN), 1, 1))
    if arm.gripper.up is not None:
        tilts = tilts[:1]
        tilts[0, :3, :3] = Rotation.align_vectors([[0, 0, 1]], [arm.gripper.up])[0].as_matrix()
        return [tilts[0]]
    angles = list(product(DOWN, TURN))
    tilts[:, :3, :3] = Rotation.from_euler("YZ", angles, degrees=True).as_matrix()
    return [*tilts]


def _spots(surface: LevelPatch, inside: float = 0.0) -> Floats:
    """(N, 3) points of a surface, if possible some way inside of it."""
    spots = spots_on(surface.outline, SPACING)
    edges = shapely.distance(surface.outline.boundary, shapely.points(spots))
    spots = spots[edges >= inside] if (edges >= inside).any() else spots
    if not len(spots):
        spots = shapely.get_coordinates(surface.outline.representative_point())
    return np.column_stack([spots, np.full(len(spots), surface.height)])


def _reaches_over(arm: Arm, spot: Floats) -> Floats | None:
    """The position (D,) that brings the grasp frame above a spot (3,), robot's frame; else None.

    In a usual direction.
    """
    heading = math.degrees(math.atan2(spot[1], spot[0]))
    angles = [(heading, down, turn) for down in DOWN for turn in TURN]
    ways = Rotation.from_euler("ZYZ", angles, degrees=True).as_matrix()
    for up in ABOVE:
        pose = np.eye(4)
        pose[:3, 3] = spot[0], spot[1], spot[2] + up
        if arm.is_far(pose[:3, 3]) or not arm.reaches_point(pose[:3, 3], starts=STARTS):
            continue
        for pose[:3, :3] in ways:
            position = arm.reach(pose, starts=STARTS)
            if position is not None:
                return position
    return None
