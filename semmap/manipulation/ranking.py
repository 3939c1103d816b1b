"""How likely actions succeed, by all outcomes on the object and on objects of a similar shape.

Evidence counts at three levels: families of actions on similar shapes, then on the object itself,
then the action. Each level is the prior of the next one. A grasp that trial and error had to move
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
from semmap.manipulation.evaluation import group_of, shifted
from semmap.manipulation.reader import in_model, read_shape

PRIOR = 0.5
"""Attempts that a level counts as a prior of the next one: one attempt in simulation."""

NEIGHBOUR = 0.5
"""What an attempt of a similar action on the same object counts."""

LEAST = 0.002
"""Metres below which moving a grasp changes nothing."""


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


@dataclass(eq=False)
class Evidence:
    """Outcomes on an object model (`own`) and on those of a similar shape (`alike`).

    `shifts` are those that succeeded on similar shapes, by group, with their weights: (4,) x, y, z
    in the frame of the shape, and the part of those that only reach further, along the approach; as
    shares of the shape's largest size.
    """

    alike: _Level = field(default_factory=_Level)
    own: _Level = field(default_factory=_Level)
    shifts: dict[str, list[tuple[Floats, float]]] = field(default_factory=dict)

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
        aside = np.hypot(shift[0], shift[1]) > LEAST  # such as towards the heavy end of the shape
        place = pose.rotation_matrix @ np.array(shift) if aside else np.zeros(3)
        part = np.append(place, 0.0 if aside else shift[2]) / extent
        if np.linalg.norm(part) <= 1:
            self.shifts.setdefault(group, []).append((part, outcomes.successes))

    def expected(
        self, family: str, quality: float, tried: Tally = NONE, *, moved: bool = False
    ) -> float:
        """The expected share of successes of an action; its outcomes `tried` are in `own`."""
        key = group_of(family), moved
        prior = self.alike.groups.get(key, NONE).expected(self.alike.every.expected(1) * quality)
        near = NONE.plus(self.own.groups.get(key, NONE).plus(tried, -1), NEIGHBOUR)
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
        return found if np.linalg.norm(found) > LEAST else None


def evidence_on(session: Session, object_id: int, gripper: str, kind: str = "grasp") -> Evidence:
    """The outcomes on an object model and on similar shapes, by ``similar_outcomes`` in SQL."""
    found = Evidence()
    rows = session.execute(
        "SELECT family, own, attempts, successes, shift, pose, extent "
        "FROM similar_outcomes(%s, %s, %s)",
        (object_id, gripper, kind),
    )
    for family, own, attempts, successes, shift, pose, extent in rows.fetchall():
        place = None if pose is None else Pose(*pose)
        found.add(family, own, Tally(attempts, successes), shift, place, extent)
    return found


def ranked(
    session: Session, rows: Sequence[dict[str, Any]], gripper: str, kind: str = "grasp"
) -> list[dict[str, Any]]:
    """Rows of `actions_on` with `expected` by all outcomes on them and on similar shapes, in order.

    What succeeded on an object at least as often as it failed comes before all else: it takes the
    place of what was proposed before (Tosello et al., section IV-C).
    """
    evidence: dict[int, Evidence] = {}
    found = []
    for row in rows:
        number = row["object_id"]
        if number not in evidence:
            evidence[number] = evidence_on(session, number, gripper, kind)
        by_all = {"expected": _expected(evidence[number], row), "quality": _quality(row)}
        found.append(row | by_all)
    return best_first(found)


def best_first(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows in the order in which they are tried: first those that mostly succeeded."""
    return sorted(rows, key=lambda row: (not _proven(row), -row["expected"], row["action_id"]))


def _proven(row: dict[str, Any]) -> bool:
    return bool(0 < row["successes"] >= row["attempts"] / 2)


def _expected(evidence: Evidence, row: dict[str, Any]) -> float:
    tried = Tally(row["attempts"], row["successes"])
    family, moved = row["family"] or "", row["shift"] is not None
    return evidence.expected(family, _quality(row), tried, moved=moved)


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
    moved = {group_of(row["family"] or "") for row in rows if row["shift"] is not None}
    found = []
    for row in rows:
        family, quality = row["family"] or "", _quality(row)
        if row["shift"] is not None or group_of(family) in moved:
            continue
        grasp = replace(grasp_of_row(row, opening), quality=quality)
        shift = evidence.shift(grasp, pose, extent)
        better = evidence.expected(family, quality, moved=True) > _expected(evidence, row)
        if shift is not None and better:
            found.append(shifted(grasp, shift))
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
