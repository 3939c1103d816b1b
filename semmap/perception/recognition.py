"""Which known objects the clusters of a cloud are, and where; "unknown" where no model fits.

Views with a descriptor like the cluster's suggest poses, which ICP refines (O'Neill's thesis,
section 5.0.4). The pose decides, not the descriptor: the cluster has to be on the model, and the
model on the cluster, except where something nearer hides it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from semmap.perception.models import VOXEL, KnownObject, ModelView, PointView, describe
from semmap.perception.placeholders import Placeholder, subtract_placeholder
from semmap.perception.plane import unit_vector
from semmap.perception.point_cloud import Floats, PerceptionError, checked_points, voxel_downsample
from semmap.perception.registration import moved
from semmap.perception.tabletop import clusters_of, segment_tabletop

SUGGESTED = 8  # views of each model whose descriptors are nearest
ROLLS = 3  # angles about the line of sight of each view
ALIGNED, SCORED = 6, 2  # poses of each model that ICP refines with few points, and with all
NEAR = 0.006  # points nearer to a surface are on it, metres
LEAST_SCORE = 0.9  # an answer of less is unknown

LEAST_COVERED = 0.25
"""Share of a model's view that the cluster has to cover: less may be a part of anything."""

FEWEST = 30

GAP = 0.015  # metres between clusters of what remains without furniture
HEADROOM = 0.5  # metres above furniture in which objects stand on it

RATES = (0.91, 0.011)
"""P(answered | it is this object in view), P(answered | it is another one): docs/perception.md."""


@dataclass(frozen=True, eq=False)
class Recognition:
    """What a cluster is."""

    name: str | None  # of the model; None if no model fits
    pose: Floats | None  # (4, 4) the frame of the model in the frame of the cloud; None if unknown
    # share of the cluster on the model times share of the visible model on the cluster, in [0, 1],
    # of the best model even if it is too low for an answer
    score: float
    centre: Floats  # (3,) mean of the points, metres


class Scene:
    """All that a camera at `eye` (3,) saw, metres: which points hide what is behind them."""

    def __init__(self, points: ArrayLike, eye: ArrayLike = (0, 0, 0)) -> None:
        cloud = checked_points(points, FEWEST)
        self.eye = np.asarray(eye, float)
        if self.eye.shape != (3,) or not np.isfinite(self.eye).all():
            raise PerceptionError(f"the eye is {eye!r}: give three finite numbers, metres")
        ray = cloud - self.eye
        self._range = np.linalg.norm(ray, axis=1)
        self._tree = cKDTree(ray / np.maximum(self._range, 1e-9)[:, None], balanced_tree=False)

    def sees_through(self, points: Floats) -> NDArray[np.bool_]:
        """Return which points (n, 3) are before what the camera saw in their direction."""
        ray = points - self.eye
        distance = np.linalg.norm(ray, axis=1)
        # A direction without a measurement says nothing.
        off, nearest = self._tree.query(ray / distance[:, None], distance_upper_bound=0.01)
        beyond = np.zeros(len(points))
        measured = np.isfinite(off)
        beyond[measured] = self._range[nearest[measured]] - distance[measured]
        return np.asarray(beyond >= 2 * NEAR)


def recognise(
    points: ArrayLike,
    models: Sequence[KnownObject],
    *,
    up: ArrayLike = (0, 0, 1),
    eye: ArrayLike = (0, 0, 0),
    placeholders: Sequence[Placeholder] = (),
    least_score: float = LEAST_SCORE,
) -> list[Recognition]:
    """Return what stands on the table that a camera sees, the largest cluster first.

    Parameters
    ----------
    points : (n, 3) or (height, width, 3) metres
    up, eye : (3,) upwards, and where the camera was, in the frame of the points
    placeholders : known furniture, whose points are removed; then there need be no table's plane.
        Objects are clusters of what remains in the box around it and half a metre above it
    least_score : an answer of less is unknown

    Raises
    ------
    PerceptionError
        A cloud without points or table, see `segment_tabletop`; furniture that is not where it is
        believed; no model.
    """
    scene = Scene(points, eye)
    if placeholders:
        rest, held = np.asarray(points), []
        for placeholder in placeholders:
            subtraction = subtract_placeholder(rest, placeholder)
            rest = subtraction.remaining
            held.append((placeholder, subtraction.pose))
        in_reach = [_in_reach(rest, placeholder, pose, up) for placeholder, pose in held]
        rest = rest[np.any(in_reach, axis=0)]
        clusters = clusters_of(voxel_downsample(rest, VOXEL) if len(rest) else rest, GAP, FEWEST)
    else:
        clusters = list(segment_tabletop(points, up=up).clusters)
    return [
        recognise_cluster(cluster, models, scene, least_score=least_score) for cluster in clusters
    ]


def _in_reach(
    points: Floats, placeholder: Placeholder, pose: Floats, up: ArrayLike
) -> NDArray[np.bool_]:
    """Whether points are in the box around aligned furniture, or above it."""
    local = moved(_inverse(pose), points)
    above = HEADROOM * (pose[:3, :3].T @ unit_vector(up, "up"))
    low = placeholder.surface.min(axis=0) + np.minimum(above, 0) - GAP
    high = placeholder.surface.max(axis=0) + np.maximum(above, 0) + GAP
    return np.asarray(((local > low) & (local < high)).all(axis=1))


def recognise_cluster(
    cluster: ArrayLike,
    models: Sequence[KnownObject],
    scene: Scene,
    *,
    least_score: float = LEAST_SCORE,
) -> Recognition:
    """Return which model a cluster (n, 3), metres, is of, and its pose.

    Raises PerceptionError: fewer than 30 finite points, or no model.
    """
    if not models:
        raise PerceptionError("there is no model: train one from a mesh")
    points = voxel_downsample(checked_points(cluster, FEWEST, "the cluster"), VOXEL)
    away = np.linalg.norm(points - points.mean(axis=0), axis=1)
    fitting = [model for model in models if np.quantile(away, 0.95) < model.width]
    if len(points) < FEWEST or not fitting:
        return Recognition(None, None, 0.0, points.mean(axis=0))
    look = describe(points, scene.eye)
    best = max((_fit(points, look, model, scene) for model in fitting), key=lambda found: found[0])
    score, pose, name = best
    known = score >= least_score
    return Recognition(name if known else None, pose if known else None, score, look.centre)


def _fit(
    points: Floats, look: PointView, model: KnownObject, scene: Scene
) -> tuple[float, Floats, str]:
    """The score and pose of the model's best fit to a cluster."""
    distance = np.linalg.norm(model.descriptors - look.descriptor, axis=1)
    starts = [
        pose
        for number in np.argsort(distance)[:SUGGESTED]
        for pose in _poses(look, model.views[number])
    ]
    few = points[:: max(len(points) // 150, 1)]
    rough = model.target.prepared(few)
    near = [
        model.target.align(rough, pose, 0.03, 15) for pose in _nearest(starts, few, model, ALIGNED)
    ]
    source = model.target.prepared(points)
    found: tuple[float, Floats, str] = (0.0, np.eye(4), model.name)
    for start in _nearest(near, few, model, SCORED):
        pose = model.target.align(source, start, 0.01)
        score = _score(points, pose, model, scene)
        if score > found[0]:
            found = (score, _inverse(pose), model.name)
    return found


def _nearest(poses: list[Floats], points: Floats, model: KnownObject, count: int) -> list[Floats]:
    """The poses of the camera in the model's frame that bring points nearest to the model."""
    off = [
        np.minimum(model.tree.query(moved(pose, points), distance_upper_bound=0.03)[0], 0.03).mean()
        for pose in poses
    ]
    return [poses[number] for number in np.argsort(off, kind="stable")[:count]]


def _inverse(pose: Floats) -> Floats:
    return np.asarray(np.linalg.inv(pose), float)


def _poses(look: PointView, view: ModelView) -> list[Floats]:
    """The camera's frame in the model's, for the rolls that bring a view to the cluster."""
    spectrum = np.fft.rfft(look.signature) * np.conj(np.fft.rfft(view.look.signature))
    alike = np.fft.irfft(spectrum, look.signature.shape[1]).sum(axis=0)
    poses = []
    for _ in range(ROLLS):
        best = int(alike.argmax())
        angle = 2 * np.pi * best / len(alike)
        alike[(best + np.arange(-4, 5)) % len(alike)] = -np.inf
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        pose = np.eye(4)
        pose[:3, :3] = view.look.frame @ turn.T @ look.frame.T
        pose[:3, 3] = view.look.centre - pose[:3, :3] @ look.centre
        poses.append(pose)
    return poses


def _score(points: Floats, pose: Floats, model: KnownObject, scene: Scene) -> float:
    """How well a pose of the camera in the model's frame explains what is and is not seen."""
    on_model = float((model.tree.query(moved(pose, points))[0] < NEAR).mean())
    eye = moved(pose, scene.eye[None])[0] - model.points.mean(axis=0)
    view = model.views[int((model.directions @ eye).argmax())]
    covered = cKDTree(moved(pose, points)).query(view.points)[0] < NEAR
    through = ~covered & scene.sees_through(moved(_inverse(pose), view.points))
    if covered.mean() < LEAST_COVERED:
        return 0.0
    return on_model * float(covered.sum()) / float(covered.sum() + through.sum())
