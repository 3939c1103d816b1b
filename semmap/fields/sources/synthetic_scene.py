"""A scene for sensors: things and people, and what a camera with perfect masks sees of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import ArrayLike, NDArray
from trimesh.creation import capsule, icosphere

from semmap.draw.depth_camera import DepthCamera, look_at
from semmap.fields.sources.percepts import Gaze, Moving, People, Segmentation

__all__ = ["EYES", "Actor", "Prop", "Stage", "standpoints"]

EYES = 1.6
"""Metres above the ground at which people look."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prop:
    """Something to be seen: its name, its type, and its triangles (F, 3, 3) in the map's frame."""

    name: str
    type: str
    triangles: Floats


@dataclass(frozen=True)
class Actor:
    """Somebody who stands at (x, y, z) and looks at a point, metres."""

    name: str
    x: float
    y: float
    z: float
    looks_at: tuple[float, float, float]

    @property
    def eyes(self) -> tuple[float, float, float]:
        """A little ahead of the body, so that it does not fill what it sees."""
        ahead = np.array([self.looks_at[0] - self.x, self.looks_at[1] - self.y])
        x, y = (self.x, self.y) + 0.12 * ahead / max(float(np.linalg.norm(ahead)), 1e-9)
        return float(x), float(y), self.z + EYES

    @property
    def body(self) -> Prop:
        """A capsule and a head, 1.75 m high."""
        trunk = capsule(height=1.1, radius=0.19, count=(24, 12))
        trunk.apply_translation((self.x, self.y, self.z - trunk.bounds[0][2]))
        head = icosphere(2, radius=0.12)
        head.apply_translation((self.x, self.y, self.z + EYES + 0.03))
        triangles = np.concatenate([trunk.triangles, head.triangles])
        return Prop(self.name, "person", np.asarray(triangles, np.float64))


class Stage:
    """Props and actors at a time.

    Parameters
    ----------
    time : aware
    """

    def __init__(self, props: Sequence[Prop], actors: Sequence[Actor], time: datetime) -> None:
        self.props = [*props, *(actor.body for actor in actors)]
        self.actors = tuple(actors)
        self.time = time
        counts = [len(p.triangles) for p in self.props]
        self.owner = np.repeat(np.arange(len(self.props)), counts)
        parts = [p.triangles for p in self.props]
        self.triangles: Floats = np.concatenate([np.zeros((0, 3, 3)), *parts])

    def seen(
        self,
        eye: ArrayLike,
        target: ArrayLike,
        size: tuple[int, int] = (640, 480),
        *,
        field: float = math.radians(60),
        of: Callable[[Prop], str] = lambda prop: prop.type,
    ) -> Segmentation:
        """What a camera at `eye` that looks at `target` sees, with the name of each pixel's prop.

        Parameters
        ----------
        size : width and height, pixels
        field : how wide it sees, radians
        of : what pixels of a prop are named; the type by default
        """
        camera = _camera(eye, target, size, field)
        depth, face = camera.image(self.triangles)
        named = [of(prop) for prop in self.props]
        number = {name: i for i, name in enumerate(dict.fromkeys(named), 1)}
        table = np.array([number[name] for name in named] or [0], np.int32)
        labels = np.zeros(face.shape, np.int32)
        labels[face >= 0] = table[self.owner[face[face >= 0]]]
        names = {i: name for name, i in number.items()}
        return Segmentation(depth, labels, names, camera.intrinsics, camera.pose, self.time)

    def people(self, seen: Segmentation) -> Segmentation:
        """Of an image whose pixels are named by prop, the people."""
        names = {a.name for a in self.actors}
        kept = {i: name for i, name in seen.names.items() if name in names}
        labels = np.where(np.isin(seen.labels, [*kept]), seen.labels, 0)
        return Segmentation(seen.depth, labels, kept, seen.intrinsics, seen.pose, seen.time)

    def gazes(self) -> Gaze:
        """Where the actors look."""
        return Gaze({a.name: look_at(a.eyes, a.looks_at) for a in self.actors}, self.time)

    def motions(self) -> People:
        """Where the actors stand."""
        return People(
            {
                a.name: Moving(
                    a.x, a.y, math.atan2(a.looks_at[1] - a.y, a.looks_at[0] - a.x), z=a.z
                )
                for a in self.actors
            },
            self.time,
        )


def standpoints(
    stage: Stage, target: str, ground: float, *, distance: float = 1.6, directions: int = 24
) -> list[tuple[float, float]]:
    """Where around a prop one may stand and see it: (x, y), the best view first, none beside it.

    Nothing of the scene is within 0.3 m of the place from knee to head.
    """
    (prop,) = [p for p in stage.props if p.name == target]
    middle = prop.triangles.reshape(-1, 3).mean(axis=0)
    number = stage.props.index(prop)
    low, high = stage.triangles.min(axis=1), stage.triangles.max(axis=1)
    found: list[tuple[int, float, float]] = []
    for angle in np.arange(directions) * 2 * math.pi / directions:
        for away in (distance, 0.7 * distance, 1.3 * distance):
            x, y = middle[:2] + away * np.array([math.cos(angle), math.sin(angle)])
            near = (low[:, 0] < x + 0.3) & (high[:, 0] > x - 0.3)
            near &= (low[:, 1] < y + 0.3) & (high[:, 1] > y - 0.3)
            near &= (low[:, 2] < ground + 1.7) & (high[:, 2] > ground + 0.4)
            if near.any():
                continue
            camera = _camera((x, y, ground + EYES), middle, (160, 120), math.radians(30))
            _, face = camera.image(stage.triangles)
            pixels = int((stage.owner[face[face >= 0]] == number).sum())
            if pixels > 4:
                found.append((pixels, float(x), float(y)))
                break
    found.sort(reverse=True)
    apart: list[tuple[float, float]] = []
    for _, x, y in found:
        if all(math.dist((x, y), other) > 0.8 for other in apart):
            apart.append((x, y))
    return apart


def _camera(eye: ArrayLike, target: ArrayLike, size: tuple[int, int], field: float) -> DepthCamera:
    focal = size[0] / 2 / math.tan(field / 2)
    middle = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    return DepthCamera(size, (focal, focal, *middle), look_at(eye, target))
