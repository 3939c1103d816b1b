"""How steadily grasps hold an object as it stands: beside its centre of mass, it turns in the pads.

Two pads hold against gravity by friction, and against turning about the closing axis by friction at
the radius of the pads. A quarter of the heaviest load may so hang at four times that radius. A
suction cup holds up to a weight that follows from its vacuum (`heaviest`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from semmap.arrays import Floats
from semmap.manipulation.candidates import FRICTION
from semmap.manipulation.evaluation import SHIFTED
from semmap.manipulation.gripper import PAD, Gripper
from semmap.manipulation.solids import PrimitiveShape, solid_of
from semmap.manipulation.suction import Cup, heaviest

HOLD = 1.5 * PAD
"""Metres beside the centre of mass at which a grasp is half as steady."""

LEAST = 0.03
"""The steadiness below which a grasp holds nothing up: some 17 cm beside the centre of mass."""

DENSITY, GRAVITY = 500.0, 9.81
"""kg/m³ of objects of unknown mass, as in trials, and m/s²."""

SAFETY = 2.0
"""Of the weight: what a cup holds of an object that it moves, with up to 1 g."""


def steadiness(
    rows: Sequence[Mapping[str, Any]],
    shape: PrimitiveShape,
    gripper: Gripper | None = None,
    mass: float | None = None,
) -> Floats:
    """(N,) 1 for grasps above, below or at the centre of mass, less the farther beside it they are.

    Of a suction cup, what it holds as a share of `SAFETY` times the weight; 0 for less than the
    weight. Rows have `pose` in the map's frame, None (it counts as 1) where the object has none,
    `model_pose` in that of the model and `width`. The centre of mass is that of `shape`, which is
    in the frame of the model; `mass` in kg is by default that of the shape by `DENSITY`.
    """
    share = np.ones(len(rows))
    placed = [k for k, row in enumerate(rows) if row["pose"] is not None]
    if placed:
        share[placed] = _of_placed([rows[k] for k in placed], shape, gripper, mass)
    return share


def _of_placed(
    rows: Sequence[Mapping[str, Any]],
    shape: PrimitiveShape,
    gripper: Gripper | None,
    mass: float | None,
) -> Floats:
    """The steadiness of rows that have a pose."""
    there = np.array([row["pose"].matrix for row in rows])
    in_model = np.array([row["model_pose"].matrix for row in rows])
    middle = shape.pose @ np.append(solid_of(shape.kind, shape.size).centre, 1.0)
    centre = (there @ np.linalg.inv(in_model) @ middle)[:, :3]
    if gripper is not None and gripper.cup is not None:
        kilograms = DENSITY * solid_of(shape.kind, shape.size).volume if mass is None else mass
        return _of_cup(gripper.cup, there, centre, kilograms * GRAVITY)
    closing = there[:, :3, 0]
    pads = there[:, :3, 3]
    if gripper is not None:
        widths = np.array([gripper.opening if (w := row["width"]) is None else w for row in rows])
        pads = pads + np.einsum("nij,nj->ni", there[:, :3, :3], gripper.pads_at(widths))
    lever = centre - pads
    lever[:, 2] = 0  # what hangs straight below does not turn
    lever -= np.einsum("ni,ni->n", lever, closing)[:, None] * closing
    share: Floats = 1 / (1 + (lever**2).sum(axis=1) / HOLD**2)
    return share


def _of_cup(cup: Cup, poses: Floats, centre: Floats, weight: float) -> Floats:
    """(N,) how much of `SAFETY` times a weight in newtons a cup holds at poses (N, 4, 4)."""
    down = -poses[:, 2, :3]
    lever = np.einsum("nij,ni->nj", poses[:, :3, :3], centre - poses[:, :3, 3])
    share = heaviest(cup, down, lever, FRICTION) / weight
    return np.where(share < 1, 0.0, np.minimum(share / SAFETY, 1.0))


def steady_rows(
    rows: Sequence[dict[str, Any]],
    shape: PrimitiveShape,
    gripper: Gripper | None = None,
    mass: float | None = None,
) -> list[dict[str, Any]]:
    """Rows that hold the object as it stands; in `expected`, their quality is times the steadiness.

    Those that trial and error moved aside stay as they are: the object is heavy at one end.
    Outcomes count as before. `quality` is that without steadiness.
    """
    found = []
    for row, share in zip(rows, steadiness(rows, shape, gripper, mass), strict=True):
        attempts = row["attempts"]
        quality = (row["expected"] * (attempts + 2) - row["successes"]) / 2
        if row["shift"] is not None and np.hypot(*row["shift"][:2]) > SHIFTED:
            found.append(row | {"quality": quality})
        elif row["successes"] or share >= LEAST:
            less = 2 * float(1 - share) * quality / (attempts + 2)
            found.append(row | {"expected": row["expected"] - less, "quality": quality})
    return found


def unsteady(entity: str, grasps: int, gripper: Gripper | None = None) -> str:
    """Why none of an entity's grasps holds it."""
    if gripper is not None and gripper.cup is not None:
        return (
            f"{entity}: is too heavy for the suction cup of {gripper.cup.force:.3g} N at "
            f"{grasps} grasps where it is tight; its property weight or mass states the kilograms, "
            f"else {DENSITY:g} kg/m³ are assumed"
        )
    return (
        f"{entity}: would turn in the hand at all {grasps} grasps that fit, which hold it far "
        "beside its centre of mass"
    )
