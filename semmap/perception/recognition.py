"""Which known objects the clusters of a cloud are, and where; "unknown" where no model fits.

The chain is that of O'Neill's thesis (section 5.0.4): views whose descriptors are like that of the
cluster suggest poses, which ICP refines. What decides here is not the distance of descriptors but
the pose itself: the cluster's points have to be on the model, and the model's points on the
cluster, except where something nearer hides them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from semmap.perception.error import PerceptionError
from semmap.perception.models import VOXEL, Look, ModelView, ObjectModel, describe
from semmap.perception.point_cloud import Floats, checked_points, voxel_downsample
from semmap.perception.registration import IcpTarget, moved

__all__ = ["Recognition", "Scene", "recognise_cluster"]

SUGGESTED = 8
"""Views of each model whose descriptors are nearest."""

ROLLS = 3
"""Angles about the line of sight of each view."""

ALIGNED = 4
"""Poses of each model that ICP refines."""

NEAR = 0.006
"""Points nearer to a surface are on it, metres."""

LEAST_SCORE = 0.7
"""An answer of less is unknown."""

FEWEST = 30


@dataclass(frozen=True, eq=False)
class Recognition:
    """What a cluster is.

    Attributes
    ----------
    name
        Of the model; None if no model fits.
    pose
        (4, 4) the frame of the model in the frame of the cloud; None if unknown.
    score
        Share of the cluster on the model times share of the visible model on the cluster, in
        [0, 1], of the best model even if it is too low for an answer.
    centre
        (3,) mean of the points, metres.
    """

    name: str | None
    pose: Floats | None
    score: float
    centre: Floats


class Scene:
    """All that a camera saw: which points hide what is behind them.

    Parameters
    ----------
    points
        (n, 3) or (height, width, 3) metres.
    eye
        (3,) where the camera was, in the frame of the points.
    """

    def __init__(self, points: ArrayLike, eye: ArrayLike = (0, 0, 0)) -> None:
        cloud = checked_points(points, FEWEST)
        self.eye = np.asarray(eye, float)
        if self.eye.shape != (3,) or not np.isfinite(self.eye).all():
            raise PerceptionError(f"the eye is {eye}: give three finite numbers, metres")
        ray = cloud - self.eye
        self._range = np.linalg.norm(ray, axis=1)
        self._tree = cKDTree(ray / np.maximum(self._range, 1e-9)[:, None], balanced_tree=False)

    def agreement(self, points: Floats) -> tuple[int, int]:
        """Return how many of the points are where the camera saw a surface, and saw through."""
        ray = points - self.eye
        distance = np.linalg.norm(ray, axis=1)
        # A direction without a measurement says nothing.
        off, nearest = self._tree.query(ray / distance[:, None], distance_upper_bound=0.01)
        measured = np.isfinite(off)
        gap = self._range[nearest[measured]] - distance[measured]
        return int((np.abs(gap) < 2 * NEAR).sum()), int((gap >= 2 * NEAR).sum())


def recognise_cluster(
    cluster: ArrayLike,
    models: Sequence[ObjectModel],
    scene: Scene,
    *,
    least_score: float = LEAST_SCORE,
) -> Recognition:
    """Return which model a cluster is of, and its pose.

    Parameters
    ----------
    cluster
        (n, 3) metres, such as a cluster of `segment_tabletop`.
    scene
        All points that the camera saw.

    Raises
    ------
    PerceptionError
        Fewer than 30 finite points, or no model.
    """
    if not models:
        raise PerceptionError("there is no model: train one from a mesh")
    points = voxel_downsample(checked_points(cluster, FEWEST, "the cluster"), VOXEL)
    if len(points) < FEWEST:
        return Recognition(None, None, 0.0, points.mean(axis=0))
    look = describe(points, scene.eye)
    best = max((_fit(points, look, model, scene) for model in models), key=lambda found: found[0])
    score, pose, name = best
    known = score >= least_score
    return Recognition(name if known else None, pose if known else None, score, look.centre)


def _fit(points: Floats, look: Look, model: ObjectModel, scene: Scene) -> tuple[float, Floats, str]:
    """The score and pose of the model's best fit to a cluster."""
    distance = np.linalg.norm(model.descriptors - look.descriptor, axis=1)
    starts = [
        pose
        for number in np.argsort(distance)[:SUGGESTED]
        for pose in _poses(look, model.views[number])
    ]
    few = points[:: max(len(points) // 150, 1)]
    off = [
        np.minimum(model.tree.query(moved(pose, few))[0], 0.03).mean() for pose in starts
    ]  # poses of the camera in the model's frame
    target = _target(model)
    source = target.prepared(points)
    found = (0.0, np.eye(4), model.name)
    for number in np.argsort(off)[:ALIGNED]:
        pose = target.align(source, starts[number], 0.03)
        pose = target.align(source, pose, 0.01)
        score = _score(points, pose, model, scene)
        if score > found[0]:
            found = (score, np.linalg.inv(pose), model.name)
    return found


def _target(model: ObjectModel) -> IcpTarget:
    if "icp" not in model._made:
        model._made["icp"] = IcpTarget(model.points)
    return model._made["icp"]


def _poses(look: Look, view: ModelView) -> list[Floats]:
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


def _score(points: Floats, pose: Floats, model: ObjectModel, scene: Scene) -> float:
    """How well a pose of the camera in the model's frame explains what is and is not seen."""
    on_model = float((model.tree.query(moved(pose, points))[0] < NEAR).mean())
    eye = moved(pose, scene.eye[None])[0] - model.points.mean(axis=0)
    view = model.views[int((model.directions @ eye).argmax())]
    agree, through = scene.agreement(moved(np.linalg.inv(pose), view.points))
    return on_model * agree / (agree + through) if agree >= 10 else 0.0
