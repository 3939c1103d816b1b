"""Which grasps of a shape succeed, learned from outcomes of all grippers.

A Bayesian logistic regression over features that grippers have in common: where the fingers close
on the shape, how far beside its centre of mass, and how wide and deep the object is for the
gripper. Its weights have a normal prior, and expectations are the mean over their posterior, as
MacKay approximates it ("The evidence framework applied to classification networks", 1992).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit

from semmap.arrays import Floats
from semmap.manipulation.gripper import PAD
from semmap.manipulation.solids import ConvexSolid

SPREAD = 3.0
"""The standard deviation of a weight before any outcome, in log odds."""

SUCCEEDS, TEMPER = 1.0, 0.25
"""Log odds of success before any outcome: `SUCCEEDS`, and `TEMPER` of those of the quality.

Qualities order grasps; their differences say little against outcomes.
"""

GRID = np.linspace(-0.4, 0.4, 5) * PAD
"""Metres from the middle of a pad, at which it is on the object or beside it."""

STEPS, SETTLED = 30, 1e-8
"""The most steps of Newton's method, and the largest step with which it ends."""


def grasp_features(
    solid: ConvexSolid, up: Floats, poses: Floats, widths: Floats, opening: float, depth: float
) -> Floats:
    """(N, 9) features of grasps by a gripper, most of them between -1 and 1.

    Parameters
    ----------
    up : (3,) the vertical in the frame of the solid
    poses, widths : (N, 4, 4) grasp frames in that of the solid, and (N,) metres between the pads
    opening, depth : of the gripper, metres

    Returns
    -------
    1; the place between the pads on each axis of the solid, from its centre of mass, as a share of
    its half sizes; the distance of the closing axis from that centre, as a share of half of its
    diagonal; the part of the pads on the solid; the width as a share of the opening, and what lies
    between pads and palm as one of the depth; how far the approach leads down.
    """
    closing, approach = poses[:, :3, 0], poses[:, :3, 2]
    half = _half_sizes(solid)
    from_centre = poses[:, :3, 3] - solid.centre
    along = np.einsum("ni,ni->n", from_centre, closing)
    lever = np.linalg.norm(from_centre - along[:, None] * closing, axis=1)
    inside = solid.contains(poses[:, :3, 3], 1e-6)
    starts = np.where(inside[:, None], poses[:, :3, 3], solid.centre)
    before = solid.exits(starts, -approach)[0]
    return np.column_stack(
        [
            np.ones(len(poses)),
            from_centre / half,
            lever / np.linalg.norm(half),
            pads_on(solid, poses),
            widths / opening,
            np.clip(before / max(depth, 1e-3), 0, 1.5),
            -approach @ up,
        ]
    )


def pads_on(solid: ConvexSolid, poses: Floats) -> Floats:
    """(N,) the part of the pads that is on a solid, at (N, 4, 4) grasp frames in its frame."""
    across, along = np.meshgrid(GRID, GRID)
    points = np.stack([np.zeros(across.size), across.ravel(), along.ravel()])
    spread = np.einsum("nij,jk->nki", poses[:, :3, :3], points)
    on: Floats = solid.contains(poses[:, None, :3, 3] + spread).mean(axis=1)
    return on


def _half_sizes(solid: ConvexSolid) -> Floats:
    """(3,) half of the box around a solid, metres."""
    if solid.kind == "cuboid":
        return np.array(solid.size) / 2
    radius, height = solid.size[0], solid.size[-1]
    return np.array([radius, radius, radius if solid.kind == "sphere" else height / 2])


@dataclass(frozen=True, eq=False)
class GraspModel:
    """The posterior of the weights (F,) of features, with its covariance (F, F)."""

    weights: Floats
    covariance: Floats

    @classmethod
    def learn(
        cls, features: Floats, qualities: Floats, attempts: Floats, successes: Floats
    ) -> GraspModel:
        """Learn from N grasps, of which `successes` of `attempts`, weighed, went well."""
        before = _log_odds(qualities)
        precision = np.eye(features.shape[1]) / SPREAD**2
        weights = np.zeros(features.shape[1])
        for _ in range(STEPS):
            share = expit(before + features @ weights)
            slope = features.T @ (successes - attempts * share) - precision @ weights
            bend = (features.T * (attempts * share * (1 - share))) @ features + precision
            step = np.linalg.solve(bend, slope)
            length = float(np.abs(step).max())
            weights = weights + step / max(1.0, length)  # far away, Newton's steps overshoot
            if length < SETTLED:
                break
        return cls(weights, np.linalg.inv(bend))

    def expected(self, features: Floats, qualities: Floats) -> Floats:
        """(N,) the shares of successes that grasps are expected to have."""
        middle = _log_odds(qualities) + features @ self.weights
        variance = np.einsum("ni,ij,nj->n", features, self.covariance, features)
        shares: Floats = expit(middle / np.sqrt(1 + np.pi / 8 * variance))
        return shares


def _log_odds(qualities: Floats) -> Floats:
    found: Floats = SUCCEEDS + TEMPER * logit(np.clip(qualities, 0.02, 0.98))
    return found
