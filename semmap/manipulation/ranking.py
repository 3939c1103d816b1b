"""How likely actions succeed, by all outcomes on the object and on objects of a similar shape.

Evidence counts at three levels: actions on similar shapes, then on the object itself, then the
action. Each level is the prior of the next one. On similar shapes, grasps are compared by their
geometry (`GraspModel`), other actions by their families. A grasp that trial and error had to move
on similar shapes is moved alike on another one (Tosello et al., sections IV-B and IV-C).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from semmap.arrays import Floats
from semmap.belief.store.beliefs import Session
from semmap.geometry.pose import Pose
from semmap.manipulation.candidates import Grasp
from semmap.manipulation.evaluation import SHIFTED, group_of, shifted
from semmap.manipulation.grasp_model import GraspModel, grasp_features, pads_on
from semmap.manipulation.reader import in_model, read_shape
from semmap.manipulation.solids import ConvexSolid, solid_of

PRIOR = 0.5
"""Attempts that a level counts as a prior of the next one: one attempt in simulation."""

NEIGHBOUR = 0.5
"""What an attempt of a similar action on the same object counts."""


class Tally(NamedTuple):
    """Attempts and successes, weighed."""

    attempts: float = 0.0
    successes: float = 0.0

    def plus(self, other: Tally, weight: float = 1.0) -> Tally:
        """Both, the other one by a weight; none below 0."""
        return Tally(*(max(a + weight * b, 0.0) for a, b in zip(self, other, strict=True)))

    def expected(self, prior: float) -> float:
        """The share of successes that these and a prior, 0 to 1, let expect."""
        return (self.successes + PRIOR * prior) / (self.attempts + PRIOR)


NONE = Tally()


@dataclass(eq=False)
class _Level:
    """Outcomes by group of families, and by whether trial and error had moved the action."""

    every: Tally = NONE
    groups: dict[tuple[str, bool], Tally] = field(default_factory=dict)

    def add(self, key: tuple[str, bool], outcomes: Tally) -> None:
        self.every = self.every.plus(outcomes)
        self.groups[key] = self.groups.get(key, NONE).plus(outcomes)


@dataclass(frozen=True, eq=False)
class ShapeModel:
    """What outcomes on solids of one kind teach of grasps of an object by a gripper.

    `pose` (4, 4) is the solid in the frame of the object; `opening` and `depth` of the gripper are
    metres.
    """

    solid: ConvexSolid
    pose: Floats
    opening: float
    depth: float
    model: GraspModel

    def expected(self, poses: Floats, widths: Floats, qualities: Floats) -> Floats:
        """(N,) the expected shares of successes of grasps, (N, 4, 4) in the object's frame."""
        in_shape = np.linalg.inv(self.pose) @ poses
        up = self.pose[2, :3]
        features = grasp_features(self.solid, up, in_shape, widths, self.opening, self.depth)
        return self.model.expected(features, qualities)


@dataclass(eq=False)
class Evidence:
    """Outcomes on an object model (`own`) and on those of a similar shape (`alike`).

    `shifts` are those that succeeded on similar shapes, by group, with their weights: (4,) x, y, z
    in the frame of the shape, and the part of those that only reach further, along the approach; as
    shares of the shape's largest size. `by_geometry` is learned from all of both; None where there
    is no outcome of a grasp, or no shape.
    """

    alike: _Level = field(default_factory=_Level)
    own: _Level = field(default_factory=_Level)
    shifts: dict[str, list[tuple[Floats, float]]] = field(default_factory=dict)
    by_geometry: ShapeModel | None = None

    def add(
        self,
        family: str,
        own: bool,
        outcomes: Tally,
        shift: Sequence[float] | None = None,
        pose: Pose | None = None,
        extent: float | None = None,
    ) -> None:
        """Take in outcomes of a family, moved by (3,) metres at a pose in the shape's frame."""
        group = group_of(family)
        (self.own if own else self.alike).add((group, shift is not None), outcomes)
        if shift is None or pose is None or extent is None or own or not outcomes.successes:
            return
        aside = np.hypot(shift[0], shift[1]) > SHIFTED  # such as towards the heavy end of the shape
        place = pose.rotation_matrix @ np.array(shift) if aside else np.zeros(3)
        part = np.append(place, 0.0 if aside else shift[2]) / extent
        if np.linalg.norm(part) <= 1:
            self.shifts.setdefault(group, []).append((part, outcomes.successes))

    def by_family(self, family: str, quality: float, moved: bool) -> float:
        """What outcomes of the family on similar shapes let expect."""
        every = self.alike.every.expected(1)
        return self.alike.groups.get((group_of(family), moved), NONE).expected(every * quality)

    def expected(
        self,
        family: str,
        quality: float,
        tried: Tally = NONE,
        *,
        moved: bool = False,
        prior: float | None = None,
    ) -> float:
        """The expected share of successes of an action; its outcomes `tried` are in `own`.

        `prior` is that by similar shapes, by default `by_family`.
        """
        if prior is None:
            prior = self.by_family(family, quality, moved)
        own = self.own.groups.get((group_of(family), moved), NONE)
        near = NONE.plus(own.plus(tried, -1), NEIGHBOUR)
        return tried.expected(near.expected(prior))

    def shift(self, grasp: Grasp, shape_pose: Floats, extent: float) -> Floats | None:
        """How this family was moved on similar shapes, (3,) metres in the grasp's frame."""
        known = self.shifts.get(group_of(grasp.family))
        if not known:
            return None
        parts, weights = zip(*known, strict=True)
        part = extent * np.average(parts, axis=0, weights=weights)
        _, y, z = (shape_pose[:3, :3].T @ grasp.pose[:3, :3]).T @ part[:3]
        found: Floats = np.array([0.0, y, z + part[3]])  # where they close, fingers find the middle
        return found if np.linalg.norm(found) > SHIFTED else None


def evidence_on(session: Session, object_id: int, gripper: str, kind: str = "grasp") -> Evidence:
    """The outcomes on an object model and on similar shapes, by ``similar_outcomes`` in SQL."""
    found = Evidence()
    rows = session.execute(
        "SELECT family, own, attempts, successes, quality, shift, pose, width, size, up, opening, "
        "depth FROM similar_outcomes(%s, %s, %s) ORDER BY own, family, pose",
        (object_id, gripper, kind),
    ).fetchall()
    outcomes = [_Outcome(*row) for row in rows]
    for one in outcomes:
        if one.family is not None:
            pose = None if one.pose is None else Pose(*one.pose)
            extent = None if one.size is None else max(one.size)
            done = Tally(one.attempts, one.successes)
            found.add(one.family, one.own, done, one.shift, pose, extent)
    if kind == "grasp":
        found.by_geometry = _shape_model(session, object_id, gripper, outcomes)
    return found


class _Outcome(NamedTuple):
    """A row of ``similar_outcomes``."""

    family: str | None
    own: bool
    attempts: float
    successes: float
    quality: float
    shift: list[float] | None
    pose: list[float] | None
    width: float | None
    size: list[float] | None
    up: list[float] | None
    opening: float
    depth: float


def _shape_model(
    session: Session, object_id: int, gripper: str, outcomes: Sequence[_Outcome]
) -> ShapeModel | None:
    known = [one for one in outcomes if one.pose is not None and one.width is not None]
    shape = read_shape(session, object_id) if known else None
    if shape is None:
        return None
    kind = shape["shape"]
    groups: dict[tuple[Any, ...], list[_Outcome]] = {}  # on one shape by one gripper
    for one in known:
        of = tuple(one.size or ()), tuple(one.up or ()), one.opening, one.depth
        groups.setdefault(of, []).append(one)
    features = [
        grasp_features(
            solid_of(kind, size),
            np.array(up),
            np.array([Pose(*one.pose or ()).matrix for one in some]),
            np.array([one.width for one in some]),
            opening,
            depth,
        )
        for (size, up, opening, depth), some in groups.items()
    ]
    qualities, attempts, successes = (
        np.array([getattr(one, name) for some in groups.values() for one in some])
        for name in ("quality", "attempts", "successes")
    )
    model = GraspModel.learn(np.concatenate(features), qualities, attempts, successes)
    ((opening, depth),) = session.execute(
        "SELECT opening, depth FROM gripper WHERE device_id = gripper_named(%s)", (gripper,)
    ).fetchall()
    solid = solid_of(kind, shape["size"])
    return ShapeModel(solid, shape["shape_pose"].matrix, opening, depth, model)


def ranked(
    session: Session, rows: Sequence[dict[str, Any]], gripper: str, kind: str = "grasp"
) -> list[dict[str, Any]]:
    """Rows of `actions_on` with `expected` by all outcomes on them and on similar shapes, in order.

    What succeeded on an object at least as often as it failed comes before all else: it takes the
    place of what was proposed before (Tosello et al., section IV-C).
    """
    found = []
    for number in dict.fromkeys(row["object_id"] for row in rows):
        evidence = evidence_on(session, number, gripper, kind)
        of_model = [row for row in rows if row["object_id"] == number]
        expected = _expected(evidence, of_model)
        for row, share in zip(of_model, expected, strict=True):
            found.append({"quality": _quality(row)} | row | {"expected": share})
    return best_first(found)


def best_first(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows in the order in which they are tried: first those that mostly succeeded."""
    return sorted(rows, key=lambda row: (not is_proven(row), -row["expected"], row["action_id"]))


def is_proven(row: dict[str, Any]) -> bool:
    """Whether an action succeeded, and at least as often as it failed."""
    return bool(0 < row["successes"] >= row["attempts"] / 2)


def _expected(evidence: Evidence, rows: Sequence[dict[str, Any]]) -> list[float]:
    """The expected shares of successes of actions on one object model."""
    return [
        evidence.expected(
            row["family"] or "",
            _quality(row),
            Tally(row["attempts"], row["successes"]),
            moved=row["shift"] is not None,
            prior=prior,
        )
        for row, prior in zip(rows, _by_geometry(evidence, rows), strict=True)
    ]


def _by_geometry(evidence: Evidence, rows: Sequence[dict[str, Any]]) -> Sequence[float | None]:
    """Where grasps are compared by geometry, what is expected of rows; None for the others."""
    found: list[float | None] = [None] * len(rows)
    # the pose of a linked model's grasp is in the frame of another model
    own = [i for i, row in enumerate(rows) if row["width"] is not None and not row.get("link")]
    if own and evidence.by_geometry is not None:
        poses = np.array([rows[i]["model_pose"].matrix for i in own])
        widths = np.array([rows[i]["width"] for i in own])
        qualities = np.array([_quality(rows[i]) for i in own])
        shares = evidence.by_geometry.expected(poses, widths, qualities)
        for i, share in zip(own, shares.tolist(), strict=True):
            found[i] = share
    return found


def _quality(row: dict[str, Any]) -> float:
    """The quality that was predicted, from the expected share that the database has."""
    return float((row["expected"] * (row["attempts"] + 2) - row["successes"]) / 2)


def moved_alike(
    session: Session, rows: Sequence[dict[str, Any]], gripper: str, opening: float
) -> list[Grasp]:
    """Grasps of one object model that get better by moving them as those of similar shapes were."""
    evidence = evidence_on(session, rows[0]["object_id"], gripper)
    shape = read_shape(session, rows[0]["object_id"])
    if not evidence.shifts or shape is None:
        return []
    pose, extent = shape["shape_pose"].matrix, max(shape["size"])
    solid = solid_of(shape["shape"], shape["size"])
    moved = {group_of(row["family"] or "") for row in rows if row["shift"] is not None}
    found = []
    for row, expected in zip(rows, _expected(evidence, rows), strict=True):
        family, quality = row["family"] or "", _quality(row)
        if row["shift"] is not None or group_of(family) in moved:
            continue
        grasp = replace(grasp_of_row(row, opening), quality=quality)
        shift = evidence.shift(grasp, pose, extent)
        if shift is None:
            continue
        other = shifted(grasp, shift)
        if not pads_on(solid, (np.linalg.inv(pose) @ other.pose)[None])[0]:
            continue  # beside a shape that is smaller in this direction
        as_row = row | {"model_pose": Pose.from_matrix(other.pose), "shift": other.shift}
        untried = as_row | {"attempts": 0, "successes": 0, "expected": quality}
        if _expected(evidence, [untried])[0] > expected:
            found.append(other)
    return found


def grasp_of_row(row: dict[str, Any], opening: float) -> Grasp:
    """A stored grasp of `actions_on` in the frame of the model."""
    return Grasp(
        row["model_pose"].matrix,
        in_model(row, "pre_pose"),
        opening if row["width"] is None else row["width"],
        row["approach"] or "",
        row["family"] or "",
        row["quality"] if "quality" in row else _quality(row),
        row["posture"],
        row["pre_posture"],
        None if row["shift"] is None else np.array(row["shift"]),
    )
