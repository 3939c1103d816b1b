"""Motions of stored robots' arms among objects of the map: to grasp, place, push, open or turn.

The way to where an action begins is planned once; its path is stored and followed again until
something moves into it. From there the gripper moves straight, as the action states (Tosello et
al., III-A, IV-B). At last the arm goes back to where it was, with what it took.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from semmap.arrays import Floats
from semmap.geometry.pose import Pose
from semmap.manipulation.arm import Arm
from semmap.manipulation.automata import stored_arm
from semmap.manipulation.collision import Obstacles, PlacedObstacles, convex_body
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.motion import (
    STEP,
    Held,
    Stroke,
    free_strokes,
    is_free,
    plan_motion,
    straight_motions,
)
from semmap.manipulation.moving_part import MovingPart
from semmap.manipulation.part_motion import PartMotion
from semmap.manipulation.store.devices import add_path
from semmap.manipulation.store.model_shapes import model_mesh
from semmap.manipulation.surroundings import entity_triangles, obstacles_around
from semmap.query.meshes import world_triangles
from semmap.query.snapshot import Snapshot

AROUND = 1.5
"""Metres around an object whose contents are obstacles for an arm."""

TRIES = 6
"""Ends of motions to actions among which one is found, at most."""

LONGEST = 4
"""Times as long as for one end that a motion to any of several is looked for, at most."""

LIFT = 0.1
"""Metres by which an object is lifted before anything else."""

ASKED = 60
"""Actions in a row that an arm does not do, after which others count by their reach alone."""


WAYS = ("to_pre_grasp", "approach", "after", "back")
"""The ways of a motion, in order."""


@dataclass(frozen=True)
class ArmMotion:
    """A motion of an arm that does the action `row`: positions (N, D) of `joints`.

    `to_pre_grasp` leads to where the approach begins, `after` is the retreat of a place or the way
    of a push, an opening or a turn, `back` leads to the posture at the start; both may be empty.
    `path` is the id of the stored path of `to_pre_grasp`.
    """

    row: dict[str, Any]
    joints: tuple[str, ...]
    to_pre_grasp: Floats
    approach: Floats
    after: Floats
    back: Floats
    path: int
    reused: bool
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """As plain values: `joints`, `width`, `pose` of the grasp frame in the map, and `WAYS`."""
        told = {"joints": [*self.joints], "width": self.row["width"], "pose": self.row["pose"].row}
        return told | {name: getattr(self, name).round(5).tolist() for name in WAYS}


class FreeArm:
    """Which actions an arm does without touching anything; what is around is read once.

    From where the approach begins to its end, and with a grasped object straight off again, some
    posture of the arm is free, and so is how it is carried. It takes some hundredths of a second an
    action; whether the arm gets from one to the other takes seconds (`plan_action`).
    """

    def __init__(self, seen: Snapshot, arm: Arm) -> None:
        self._seen, self._arm, self._read = seen, arm, dict[tuple[str, str | None], Obstacles]()
        self._left = ASKED

    def one(self, base: Pose, rows: Iterable[dict[str, Any]]) -> dict[str, Any] | None:
        """The first in `rows`; where `ASKED` were none, it is left to missions."""
        for row in rows:
            if not self._left:
                return row
            self._left -= 1
            if any(True for _ in self.rows(base, [row])):
                self._left = ASKED
                return row
        return None

    def rows(self, base: Pose, rows: Iterable[dict[str, Any]]) -> Iterator[dict[str, Any]]:
        """Those of some grasps or places of one object, in order, from where a base stands."""
        planner = _Planner.of(self._seen, self._arm, base, self._read)
        made: tuple[_Strokes, _Strokes] | None = None
        for row in rows:
            if made is None and "on" in row:
                made = planner.place(row)[0], lambda _: []  # an empty hand gets off
            made = made or planner.grasp(row)
            strokes, back = made
            first, *others = strokes(row)
            if not is_free(self._arm, planner.start, first):
                continue
            ways = free_strokes(self._arm, planner.start, [first, *others])
            ends = (after[-1][-1] if after else before for before, after in ways)
            if any(planner.gets_off(end, back(row)) is not None for end in ends):
                yield row


def plan_action(
    seen: Snapshot,
    automaton: str,
    base: Pose,
    rows: Sequence[dict[str, Any]],
    *,
    state: Mapping[str, float] | None = None,
    seconds: float = 5.0,
) -> ArmMotion | None:
    """A motion of a robot's arm to one of these actions; None where none is found.

    The rows are actions of one kind on one object, the best first. The first stored path is
    followed into whose way nothing has moved. Else a motion is planned, for `LONGEST` times
    `seconds` at most, to that of the first `TRIES` ends which is reached first, and its path is
    stored. `state` are positions of joints at the start; the others are as the automaton
    carries. LookupError without the automaton; ManipulationError where the start touches something
    or the arm lacks a joint of `state`.
    """
    if not rows:
        return None
    _, arm = stored_arm(seen.session, automaton)
    start = _start(automaton, arm, state or {})
    planner = _Planner.of(seen, arm, base, {})._replace(automaton=automaton, start=start)
    ways = {
        "grasp": planner.grasp,
        "place": planner.place,
        "push": planner.push,
        "open": planner.open,
        "turn": planner.turn,
    }
    strokes, back = ways[rows[0]["kind"]](rows[0])
    some = [row for row in rows if row["entity"] == rows[0]["entity"]]
    return planner.first(some, strokes, back, seconds)


def _start(automaton: str, arm: Arm, state: Mapping[str, float]) -> Floats:
    """The position (D,) of an arm where some of its joints are as stated."""
    joints = [joint.name for joint in arm.joints]
    unknown = [name for name in state if name not in joints]
    if unknown:
        raise ManipulationError(
            f"{automaton}: its arm has no joint {', '.join(unknown)}; it has {', '.join(joints)}"
        )
    given = dict(zip(joints, arm.rest().tolist(), strict=True)) | dict(state)
    return np.array([given[name] for name in joints])


_Strokes = Callable[[dict[str, Any]], list[Stroke]]


class _Planner(NamedTuple):
    """A robot at its place, its arm in a position.

    Of the first of some actions on one object, `grasp`, `place`, `push`, `open` and `turn` return
    what makes the strokes of an action, and those from its end to the start. `read` has what is
    around objects, in the map's frame.
    """

    seen: Snapshot
    automaton: str
    arm: Arm
    base: Floats
    inverse: Floats
    start: Floats
    begun: float
    read: dict[tuple[str, str | None], Obstacles]

    @classmethod
    def of(
        cls,
        seen: Snapshot,
        arm: Arm,
        base: Pose,
        read: dict[tuple[str, str | None], Obstacles],
    ) -> _Planner:
        inverse = np.linalg.inv(base.matrix).astype(np.float64)
        begun = time.perf_counter()
        return cls(seen, "", arm, base.matrix, inverse, arm.rest(), begun, read)

    def pose(self, row: dict[str, Any], key: str) -> Floats:
        """A pose (4, 4) of an action in the robot's frame; at contact if it has none of the key."""
        pose: Floats = self.inverse @ (row[key] or row["pose"]).matrix
        return pose

    def around(self, entity: str, without: str | None = None) -> PlacedObstacles:
        """The obstacles around an object."""
        key = entity, without
        if key not in self.read:
            self.read[key] = obstacles_around(self.seen, entity, AROUND, without=without)
        return PlacedObstacles([self.read[key]], self.inverse)

    def itself(self, entity: str) -> Obstacles:
        """An object as an obstacle."""
        key = entity, ""
        if key not in self.read:
            self.read[key] = Obstacles(entity_triangles(self.seen, entity))
        return self.read[key]

    def grasp(self, first: dict[str, Any]) -> tuple[_Strokes, _Strokes]:
        """The open gripper takes the object, whose convex hull is a part of it on the way back."""
        around = self.around(first["entity"])
        item = self.itself(first["entity"])
        room, body = around.joined(item), convex_body(item.triangles.reshape(-1, 3))

        def strokes(row: dict[str, Any]) -> list[Stroke]:
            return [
                Stroke(self.pose(row, "pre_pose"), room),
                Stroke(self.pose(row, "pose"), around),
            ]

        def back(row: dict[str, Any]) -> list[Stroke]:
            held = Held(body, np.linalg.inv(row["pose"].matrix), self.width(row))
            up = self.pose(row, "pose")
            up[2, 3] += LIFT
            closed = self.arm.gripper.posture(held.width)  # what it holds still touches its support
            return [Stroke(up, around, closed), Stroke(self.rest, around, held=held)]

        return strokes, back

    def place(self, first: dict[str, Any]) -> tuple[_Strokes, _Strokes]:
        """The held object, by its convex hull, is put down, then the open gripper leaves."""
        around = self.around(first["on"], without=first["entity"])
        mesh = model_mesh(self.seen, first["entity"])
        body = convex_body(np.asarray(mesh.vertices))

        def strokes(row: dict[str, Any]) -> list[Stroke]:
            held = Held(body, np.linalg.inv(row["model_pose"].matrix), self.width(row))
            down = [Stroke(self.pose(row, key), around, held=held) for key in ("pre_pose", "pose")]
            leave = [] if row["post_pose"] is None else [self.pose(row, "post_pose")]
            return [*down, *(Stroke(pose, around) for pose in leave)]

        def back(row: dict[str, Any]) -> list[Stroke]:
            corners = row["spot"].apply(mesh.vertices)
            stands = Obstacles(corners[np.asarray(mesh.faces)])
            return [Stroke(self.rest, around.joined(stands))]

        return strokes, back

    def push(self, first: dict[str, Any]) -> tuple[_Strokes, _Strokes]:
        """The closed gripper pushes the object, and stays there."""
        around = self.around(first["entity"])
        room = around.joined(self.itself(first["entity"]))

        def strokes(row: dict[str, Any]) -> list[Stroke]:
            fingers = self.arm.gripper.postures[-1] | (row["posture"] or {})
            poses = [self.pose(row, key) for key in ("pre_pose", "pose", "end")]
            return [
                Stroke(pose, there, fingers)
                for pose, there in zip(poses, (room, around, around), strict=True)
            ]

        return strokes, lambda _: []

    def open(self, first: dict[str, Any]) -> tuple[_Strokes, _Strokes]:
        """The gripper takes the handle, leads the part along, and leaves it."""
        led = _LedPart.of(self, first["entity"])

        def strokes(row: dict[str, Any]) -> list[Stroke]:
            return [
                Stroke(self.pose(row, "pre_pose"), led.room),
                Stroke(self.pose(row, "pose"), led.around),
                led.stroke(row, self.width(row)),
            ]

        def back(row: dict[str, Any]) -> list[Stroke]:
            moved = led.moved(row)
            away = [] if row["post_pose"] is None else [self.pose(row, "post_pose")]
            return [*(Stroke(pose, moved) for pose in away), Stroke(self.rest, moved)]

        return strokes, back

    def turn(self, first: dict[str, Any]) -> tuple[_Strokes, _Strokes]:
        """The closed gripper pushes the part about its hinge, and stays there."""
        led = _LedPart.of(self, first["entity"])

        def strokes(row: dict[str, Any]) -> list[Stroke]:
            fingers = self.arm.gripper.postures[-1] | (row["posture"] or {})
            return [
                Stroke(self.pose(row, "pre_pose"), led.room, fingers),
                Stroke(self.pose(row, "pose"), led.around, fingers),
                led.stroke(row, 0.0)._replace(fingers=fingers),
            ]

        return strokes, lambda _: []

    @property
    def rest(self) -> Floats:
        """The pose of the grasp frame at the start, robot's frame."""
        return self.arm.grasp_pose(self.start)

    def width(self, row: dict[str, Any]) -> float:
        """Metres between the pads around the object that an action holds."""
        return float(self.arm.gripper.opening if row["width"] is None else row["width"])

    def first(
        self, rows: Sequence[dict[str, Any]], strokes: _Strokes, back: _Strokes, seconds: float
    ) -> ArmMotion | None:
        """The motion by the first stored path that is free, else to the end that is found first."""
        every = [(row, strokes(row)) for row in rows]
        for row, ways in every:
            stored = self._stored(ways)
            if stored is None:
                continue
            after = self._back(stored[1][-1][-1], back(row), seconds)
            if after is not None:
                return self._motion(row, *stored, after, reused=True)
        ends = [*islice(self._ends(every, back), TRIES)]
        while ends:
            alike = [end for end in ends if end.is_like(ends[0])]
            goals = np.array([end.before for end in alike])
            some = min(len(alike), LONGEST)
            path = plan_motion(self.arm, self.start, goals, alike[0].stroke, some * seconds)
            if path is None:
                ends = [end for end in ends if end not in alike]
                continue
            reached = alike[int(np.abs(goals - path[-1]).max(axis=1).argmin())]
            found = [path, *reached.after]
            after = self._back(found[-1][-1], back(reached.row), seconds)
            if after is not None:
                return self._motion(reached.row, self._keep(path), found, after, reused=False)
            ends.remove(reached)
        return None

    def _ends(
        self, every: Sequence[tuple[dict[str, Any], list[Stroke]]], back: _Strokes
    ) -> Iterator[_End]:
        """Where the ways to actions may end: what follows is free."""
        for row, ways in every:
            for before, after in free_strokes(self.arm, self.start, ways):
                last = after[-1][-1] if after else before
                if self.gets_off(last, back(row)) is not None:
                    yield _End(row, ways[0], before, after)

    def gets_off(self, position: Floats, strokes: list[Stroke]) -> list[Floats] | None:
        """Positions along straight strokes, if the motion to the start could begin and end."""
        if not strokes:
            return []
        *straight, last = strokes
        moved = straight_motions(self.arm, position, straight)
        if moved is None:
            return None
        begin = moved[-1][-1] if moved else position
        return moved if all(is_free(self.arm, end, last) for end in (begin, self.start)) else None

    def _back(self, position: Floats, strokes: list[Stroke], seconds: float) -> Floats | None:
        """Positions along straight strokes, and then by any free motion to the start."""
        moved = self.gets_off(position, strokes)
        if moved is None or not strokes:
            return None if moved is None else np.empty((0, len(self.start)))
        begin = moved[-1][-1] if moved else position
        way = plan_motion(self.arm, begin, self.start, strokes[-1], seconds)
        return None if way is None else np.concatenate([*moved, way])

    def _motion(
        self, row: dict[str, Any], path: int, found: Sequence[Floats], back: Floats, *, reused: bool
    ) -> ArmMotion:
        joints = tuple(joint.name for joint in self.arm.joints)
        way, approach, *others = found
        after = others[0] if others else np.empty((0, len(joints)))
        spent = time.perf_counter() - self.begun
        return ArmMotion(row, joints, way, approach, after, back, path, reused, spent)

    def _palm(self, grasp: Floats) -> Floats:
        """The pose of the palm in the map where the grasp frame is at a pose of the robot's."""
        pose: Floats = self.base @ grasp @ np.linalg.inv(self.arm.gripper.frame)
        return pose

    def _keep(self, positions: Floats) -> int:
        """Store a path; return its id."""
        names = [joint.name for joint in self.arm.joints]
        return add_path(
            self.seen.session,
            self.automaton,
            [self._palm(self.arm.grasp_pose(position)) for position in positions],
            link=self.arm.gripper.palm,
            positions=dict(zip(names, positions.T.tolist(), strict=True)),
        )

    def _stored(self, strokes: Sequence[Stroke]) -> tuple[int, list[Floats]] | None:
        """A stored path, its id, to where the first stroke ends, and then the others; all free."""
        first, *others = strokes
        here = self._palm(self.arm.grasp_pose(self.start))
        ends = (Pose.from_matrix(here).row, Pose.from_matrix(self._palm(first.pose)).row)
        row = self.seen.session.execute(
            "SELECT id, joints, positions FROM path "
            "WHERE id = path_between(%s, %s::float8[], %s::float8[], %s)",
            (self.automaton, *ends, self.arm.gripper.palm),
        ).fetchone()
        if row is None or row[1] != [joint.name for joint in self.arm.joints]:
            return None
        way = np.array(row[2])
        if np.abs(way[0] - self.start).max() > STEP:
            return None  # another posture with the same pose of the palm
        if not all(is_free(self.arm, position, first) for position in way):
            return None
        after = straight_motions(self.arm, way[-1], others)
        return None if after is None else (int(row[0]), [way, *after])


@dataclass(frozen=True, eq=False)
class _End:
    """The position (D,) before the approach to an action, and the motions (N, D) after it."""

    row: dict[str, Any]
    stroke: Stroke
    before: Floats
    after: list[Floats]

    def is_like(self, other: _End) -> bool:
        """Whether a motion to either is free of the same obstacles with the same in the hand."""
        (a, b), (held, item) = (self.stroke, other.stroke), (self.stroke.held, other.stroke.held)
        if a.obstacles is not b.obstacles or a.fingers != b.fingers:
            return False
        if held is None or item is None:
            return held is item
        return (
            held.body is item.body
            and held.width == item.width
            and np.allclose(held.pose, item.pose, atol=1e-6)
        )


class _LedPart(NamedTuple):
    """A part of the map that the gripper moves on its joint; obstacles in the robot's frame.

    `around` is without what moves along, `room` with it where it is now.
    """

    planner: _Planner
    part: MovingPart
    triangles: Floats
    around: PlacedObstacles
    room: PlacedObstacles
    body: Any

    @classmethod
    def of(cls, planner: _Planner, entity: str) -> _LedPart:
        part = MovingPart.of(planner.seen, entity)
        obstacles = obstacles_around(planner.seen, part.entity, AROUND, along=part.ids)
        around = PlacedObstacles([obstacles], planner.inverse)
        along = world_triangles(planner.seen.session, list(part.ids))
        triangles = np.concatenate([*along.values()])
        room = around.joined(Obstacles(triangles))
        body = convex_body(part.pose.apply(part.corners))
        return cls(planner, part, triangles, around, room, body)

    def stroke(self, row: dict[str, Any], width: float) -> Stroke:
        """The gripper keeps to the part along its way; no other link of the arm touches it."""
        steps = self._steps(row)
        through = self.planner.inverse @ steps @ row["pose"].matrix
        held = Held(self.body, np.linalg.inv(row["pose"].matrix), width, led=True)
        return Stroke(through[-1], self.around, held=held, through=through[1:])

    def moved(self, row: dict[str, Any]) -> PlacedObstacles:
        """The obstacles where the part is at the end of its way."""
        end = self._steps(row)[-1]
        moved = self.triangles @ end[:3, :3].T + end[:3, 3]
        return self.around.joined(Obstacles(moved))

    def _steps(self, row: dict[str, Any]) -> Floats:
        """Displacements (K, 4, 4) of the part in the map's frame."""
        motion = PartMotion.of_numbers(row["motion"]).moved(self.part.pose)
        return motion.steps(np.asarray(self.part.pose.apply(self.part.corners)))
