"""How parts of the map are opened and turned: stored actions before generated ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from semmap.arrays import Floats
from semmap.geometry.pose import Pose
from semmap.manipulation.action_record import ActionRecord
from semmap.manipulation.arm import Arm
from semmap.manipulation.automata import reachable_rows
from semmap.manipulation.candidates import Grasps
from semmap.manipulation.collision import (
    GAP,
    Obstacles,
    convex_body,
    free_grasps,
    swept_link,
)
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.found_actions import FoundActions
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.handles import opening_grasps, opening_records
from semmap.manipulation.moving_part import Aim, MovingPart, unknown_axis
from semmap.manipulation.part_motion import PartMotion
from semmap.manipulation.ranking import ranked
from semmap.manipulation.reader import STORED, actions_on
from semmap.manipulation.retrieval import gripper_name, stored_gripper
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.suitability import reasons_against
from semmap.manipulation.surroundings import REACH, ids_around, obstacles_around
from semmap.manipulation.turning import turn_records
from semmap.query.entity_query import entity_id
from semmap.query.meshes import world_triangles
from semmap.query.snapshot import Snapshot


def find_openings(seen: Snapshot, entity: str, **asked: Any) -> FoundActions:
    """The best ways to open a part by its handle; generated where none is stored.

    The part and what it holds meet nothing on the way, and neither does the gripper that keeps to
    the handle, nor when it leaves. Arguments and rows are those of `find_turns`.
    """
    return _find(seen, entity, "open", **asked)


def find_turns(seen: Snapshot, entity: str, **asked: Any) -> FoundActions:
    """The best ways to push a part about its hinge with closed fingers, as `find_openings`.

    Parameters
    ----------
    hinge : x, y, z, dx, dy, dz: a point and the direction of its axis in the map's frame; by
        default that of its joint
    slide : dx, dy, dz: the direction in which it slides, map's frame; only of openings
    travel : radians or metres that it moves from where it is, below 0 against the axis; by default
        as its limits allow. Where only stored ways tell how it slides, metres along them
    gripper : of a name; the preferred one where None
    arm, base : only those that an arm of this gripper reaches whose robot stands at `base`
    limit : the most rows

    Returns
    -------
    FoundActions
        Rows are those of `actions_on`, with `end` (the pose of the gripper where the way ends,
        map's frame) and `travel`; with an arm, `position` of its joints where the approach begins.
        `entity` is the part, also where one named what is fixed to it.

    Raises
    ------
    LookupError
        There is no such entity or gripper.
    ManipulationError
        It has no mesh, nothing tells how it moves, or its joint does not allow the travel.
    """
    return _find(seen, entity, "turn", **asked)


def _find(
    seen: Snapshot,
    entity: str,
    aim: Aim,
    *,
    hinge: Sequence[float] | None = None,
    slide: Sequence[float] | None = None,
    travel: float | None = None,
    gripper: str | None = None,
    arm: Arm | None = None,
    base: Pose | None = None,
    limit: int = 10,
) -> FoundActions:
    chosen = gripper_name(seen.session, gripper)
    hand = stored_gripper(seen.session, chosen)
    part = MovingPart.of(seen, entity)
    if hand.cup is not None:
        does = "closes on no handle" if aim == "open" else "pushes nothing about a hinge"
        why = f"{part.entity}: gripper {chosen} is a suction cup, whose soft lip {does}"
        return FoundActions([], [why])
    number = entity_id(seen.session, part.entity)
    excluded = reasons_against(seen, aim, hand.kind, [number])
    if excluded:
        return FoundActions([], [*excluded.values()])
    motion = part.stated_motion(hinge, slide, travel) or part.known_motion(seen, aim, travel)
    rows, generated = _stored(seen, part, chosen, aim, motion, travel), []
    if motion is None and not rows:
        raise unknown_axis(seen, part.entity)
    if motion is not None and not rows:
        records = _generated(part, motion, hand, aim)
        if not records:
            what = "its handle fits" if aim == "open" else "no face of it is pushed by"
            return FoundActions([], [f"{part.entity}: no grasp of {what} gripper {chosen}"])
        add_actions(seen.session, part.entity, chosen, records)
        rows, generated = _stored(seen, part, chosen, aim, motion, travel), [part.entity]
    way = PartWay.of(seen, part, PartMotion.of_numbers(rows[0]["motion"]))
    blocked = way.blocked()
    if blocked is not None:
        return FoundActions([], [blocked], generated)
    found = way.free_rows(rows, hand, limit if arm is None or base is None else len(rows))
    if not found:
        problem = (
            f"{part.entity}: at all {len(rows)} ways to {aim} it, the gripper touches what is "
            "around, or the part before it is there"
        )
        return FoundActions([], [problem], generated)
    if arm is None or base is None:
        return FoundActions(found[:limit], [], generated)
    reached = reachable_rows(found, arm, base, limit)
    where = f"the arm at ({base.x:g}, {base.y:g})"
    problem = f"{part.entity}: {where} reaches none of {len(found)} free ways to {aim} it"
    return FoundActions(reached, [] if reached else [problem], generated)


def _generated(part: MovingPart, motion: PartMotion, hand: Gripper, aim: Aim) -> list[ActionRecord]:
    if aim == "turn":
        return turn_records(part.mesh, motion, hand)
    upright = part.pose.rotation_matrix.T @ (0, 0, 1)
    return opening_records(opening_grasps(part.mesh, motion, hand, upright=upright), motion)


def _stored(
    seen: Snapshot,
    part: MovingPart,
    gripper: str,
    aim: Aim,
    motion: PartMotion | None,
    travel: float | None,
) -> list[dict[str, Any]]:
    """The stored actions that move the part alike, with their ends.

    Where its motion is not known, those of the motion that is expected to succeed most; of a slide,
    `travel` is then along them, as they have no other direction: ManipulationError below 0.
    Else the sign of the travel of a row is that against the known axis.
    """
    rows = actions_on(seen, name=part.entity, gripper=gripper, kind=aim, limit=STORED)
    found = []
    for row in ranked(seen.session, rows, gripper, aim):
        if row["entity"] != part.entity or row.get("link") is not None:
            continue
        its = PartMotion.of_numbers(row["motion"])
        if motion is None and not its.is_hinge and travel is not None and travel < 0:
            raise ManipulationError(
                f"{part.entity}: travel is {travel:g}, and the map knows no direction in which it "
                "slides: give slide=(dx, dy, dz), too"
            )
        if motion is None and (travel is None or abs(its.amount - travel) < 1e-3):
            motion = its
        if motion is not None and its.is_like(motion):
            end = part.pose.matrix @ its.at(1) @ row["model_pose"].matrix
            travelled = float(np.copysign(its.amount, motion.amount))
            found.append(row | {"end": Pose.from_matrix(end), "travel": travelled})
    return found


@dataclass(frozen=True, eq=False)
class PartWay:
    """A part on its way in the map: `steps` (K, 4, 4) displace it in the map's frame.

    `obstacles` are those within `reach` metres, without what moves along.
    """

    seen: Snapshot
    part: MovingPart
    steps: Floats
    reach: float
    obstacles: Obstacles

    @classmethod
    def of(cls, seen: Snapshot, part: MovingPart, motion: PartMotion) -> PartWay:
        """The way of a part, whose motion is in the frame of its model."""
        local = motion.steps(part.corners)
        pose, inverse = part.pose.matrix, part.pose.inverse().matrix
        corners = np.column_stack([part.corners, np.ones(len(part.corners))])
        ways = np.einsum("kij,nj->kni", local, corners) - corners
        reach = REACH + float(np.linalg.norm(ways, axis=2).max())
        around = obstacles_around(seen, part.entity, reach, along=part.ids)
        return cls(seen, part, pose @ local @ inverse, reach, around)

    def blocked(self) -> str | None:
        """Why the part does not get to the end of its way; None where it does.

        Its convex hull must touch nothing on the way that it does not touch now. What it is jointed
        to, as the body of a cabinet, is around it all the way.
        """
        ids = ids_around(self.seen, self.part.entity, self.reach, along=self.part.ids)
        others = [number for number in ids if number != self.part.body]
        placed = self.part.pose.apply(self.part.corners)
        middle = placed.mean(axis=0)
        body = convex_body(middle + (placed - middle) * (1 - GAP))
        for number, triangles in world_triangles(self.seen.session, others).items():
            obstacle = Obstacles(triangles)
            if obstacle.touched_by([body], [np.eye(4)]):
                continue
            for k, step in enumerate(self.steps):
                if obstacle.touched_by([body], [step]):
                    ((name,),) = self.seen.session.execute(
                        "SELECT name FROM entity WHERE id = %s", (number,)
                    ).fetchall()
                    share = (k - 1) / (len(self.steps) - 1)
                    return (
                        f"{self.part.entity}: meets {name} after {share:.0%} of its way: give a "
                        "smaller travel, or move that first"
                    )
        return None

    def free_rows(
        self, rows: Sequence[dict[str, Any]], gripper: Gripper, wanted: int
    ) -> list[dict[str, Any]]:
        """The first rows whose gripper touches nothing before, on the way, and when it leaves."""
        found: list[dict[str, Any]] = []
        for start in range(0, len(rows), wanted):
            found += self._free(rows[start : start + wanted], gripper)
            if len(found) >= wanted:
                break
        return found[:wanted]

    def _free(self, rows: Sequence[dict[str, Any]], gripper: Gripper) -> Iterator[dict[str, Any]]:
        item = Obstacles(np.asarray(self.part.pose.apply(self.part.mesh.triangles.reshape(-1, 3))))
        opens = rows[0]["kind"] == "open"
        for row in rows:
            pose, before = row["pose"].matrix, (row["pre_pose"] or row["pose"]).matrix
            if opens:
                grasp = Grasps.of_rows(gripper, [row], pose[None], before[None])
                untouched = None if row["successes"] > 0 else item
                begins = bool(free_grasps(grasp, np.eye(4), self.obstacles, item=untouched)[0])
            else:
                begins = self._passes(gripper, len(gripper.postures) - 1, pose, before)
            if begins and self._goes_along(row, gripper):
                yield row

    def _goes_along(self, row: dict[str, Any], gripper: Gripper) -> bool:
        """Whether the gripper touches nothing along the way, and then when it leaves."""
        pose = row["pose"].matrix
        closed = len(gripper.postures) - 1
        posture = closed if row["width"] is None else gripper.index(float(row["width"]))
        links = range(len(gripper.links))
        hand = [swept_link(gripper, posture, k, np.zeros(3)) for k in links]
        for step in self.steps:
            if self.obstacles.touched_by(hand, [step @ pose] * len(hand)):
                return False
        if row["post_pose"] is None:
            return True
        return self._passes(gripper, 0, self.steps[-1] @ pose, row["post_pose"].matrix)

    def _passes(self, gripper: Gripper, posture: int, pose: Floats, from_: Floats) -> bool:
        """Whether the gripper touches nothing on a straight way to a pose, or from it."""
        back = (np.linalg.inv(pose) @ from_)[:3, 3].round(6) + 0.0
        hand = [swept_link(gripper, posture, k, back) for k in range(len(gripper.links))]
        return not self.obstacles.touched_by(hand, [pose] * len(hand))
