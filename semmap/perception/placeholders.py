"""Known furniture taken out of a cloud (O'Neill's thesis, section 5.0.5).

A shelf has no single table plane: its model is aligned, by RANSAC and ICP, and subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from semmap.perception.point_cloud import (
    Floats,
    PerceptionError,
    checked_points,
    surfels,
    voxel_downsample,
)
from semmap.perception.registration import IcpTarget, OrientedPairs, moved

PAIRS = 1500  # pairs of the scene that suggest poses
POOL = 20_000  # pairs of the model among which they look
SAME = 4  # pairs of the model that each may be
ALIGNED = 2000  # points of the scene that ICP aligns
PRIOR = 0.2  # share of the points that the largest shift costs

LEAST_SHARE = 0.3
"""Share of the points near the believed pose that must be on the aligned furniture."""


class Placeholder(NamedTuple):
    """Known furniture."""

    surface: Floats  # (m, 3) points all over it, in its own frame, metres
    believed: Floats  # (4, 4) its pose in the frame of the cloud


@dataclass(frozen=True, eq=False)
class Subtraction:
    """A cloud without a placeholder."""

    pose: Floats  # (4, 4) the aligned frame of the placeholder in the frame of the cloud
    remaining: Floats  # (n, 3) points that are not on it
    removed: float  # share of the points that are on it


def subtract_placeholder(
    points: ArrayLike,
    placeholder: Placeholder,
    *,
    shift: float = 0.3,
    turn: float = np.radians(30),
    near: float = 0.012,
    voxel: float = 0.01,
    seed: int = 0,
) -> Subtraction:
    """Align known furniture with a cloud, and return the points that are not on it.

    Parameters
    ----------
    points : (n, 3) or (height, width, 3) metres; NaN where nothing was seen
    shift, turn : how far the furniture may be from where it is believed, metres and radians
    near : distance of points that are on it, metres
    voxel : metres between the points that are aligned

    Raises
    ------
    PerceptionError
        Too few points, a pose of another shape, or furniture that is not where it is believed.
    """
    cloud = checked_points(points, 200)
    model = voxel_downsample(checked_points(placeholder.surface, 200, "the furniture"), voxel)
    guess = np.asarray(placeholder.believed, float)
    if guess.shape != (4, 4) or not np.isfinite(guess).all():
        raise PerceptionError("the believed pose is not a finite (4, 4) matrix")
    sparse = voxel_downsample(cloud, voxel)
    low, high = model.min(axis=0) - shift, model.max(axis=0) + shift
    inside = moved(np.linalg.inv(guess), sparse)
    scene = inside[((inside > low) & (inside < high)).all(axis=1)]  # in the believed frame
    if len(scene) < 100:
        raise PerceptionError(
            f"{len(scene)} points are near the believed pose of the furniture: check the pose"
        )
    target, tree = IcpTarget(model), cKDTree(model)
    random = np.random.default_rng(seed)
    starts = np.concatenate([np.eye(4)[None], _ransac(scene, model, shift, turn, random)])
    scene = scene[random.permutation(len(scene))[:ALIGNED]]
    off = [_distance(tree, moved(start, scene[:100]), 4 * voxel).mean() for start in starts]
    source = target.prepared(scene)
    best, most, likeliest = np.eye(4), 0.0, -np.inf
    middle = model.mean(axis=0)
    for number in [0, *(1 + np.argsort(off[1:], kind="stable")[:5])]:
        pose = target.align(source, starts[number], 6 * voxel, 30)
        pose = target.align(source, pose, 2 * voxel, 30)
        share = float((_distance(tree, moved(pose, scene), near) < near).mean())
        # A board fits its own underside, and slides along itself: near the belief is likelier.
        far = float(np.linalg.norm(moved(pose, middle[None])[0] - middle)) / shift
        if share - PRIOR * far > likeliest and _within(pose[None], middle, shift, turn)[0]:
            best, most, likeliest = pose, share, share - PRIOR * far
    if most < LEAST_SHARE:
        raise PerceptionError(
            f"the furniture is not where it is believed: {most:.0%} of the points there "
            "are on it; correct its pose in the map, or leave it out"
        )
    in_model = moved(best, moved(np.linalg.inv(guess), cloud))
    on = _distance(tree, in_model, near) < near
    return Subtraction(guess @ np.linalg.inv(best), cloud[~on], float(on.mean()))


def _distance(tree: cKDTree, points: Floats, most: float) -> Floats:
    """Distances to the nearest point of a tree, `most` where it is farther."""
    return np.asarray(np.minimum(tree.query(points, distance_upper_bound=most)[0], most))


def _ransac(
    scene: Floats, model: Floats, shift: float, turn: float, random: np.random.Generator
) -> Floats:
    """Poses (n, 4, 4) of the believed frame in the model's, from pairs with the same features."""
    ours = OrientedPairs(surfels(scene), PAIRS, random)
    theirs = OrientedPairs(surfels(model), POOL, random)
    if not len(ours.features) or not len(theirs.features):
        return np.empty((0, 4, 4))
    _, number = cKDTree(theirs.features).query(ours.features, SAME, distance_upper_bound=0.02)
    pair, rank = np.nonzero(number < len(theirs.features))
    poses = theirs.frames[number[pair, rank]] @ np.linalg.inv(ours.frames[pair])
    return np.asarray(poses[_within(poses, model.mean(axis=0), shift, turn)][:150])


def _within(poses: Floats, middle: Floats, shift: float, turn: float) -> NDArray[np.bool_]:
    """Which motions (n, 4, 4) are small enough to be errors of belief."""
    angle = np.arccos(np.clip((np.trace(poses[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    move = poses[:, :3, :3] @ middle + poses[:, :3, 3] - middle
    return np.asarray((np.linalg.norm(move, axis=1) <= shift) & (angle <= turn))
