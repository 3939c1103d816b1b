"""A synthetic scene: objects and people, and the images of a camera with exact labels."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import ArrayLike, NDArray
from trimesh.creation import capsule, icosphere

from semmap.draw.depth_camera import DepthCamera, look_at
from semmap.fields.sources.percepts import Gaze, People, PersonMotion, Segmentation

EYES = 1.6
"""Height of the eyes of people above the floor, metres."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VisibleObject:
    """An object that a camera can see."""

    name: str  # of the entity
    type: str  # its semantic type
    triangles: Floats  # (F, 3, 3) metres, in the frame of the map


@dataclass(frozen=True)
class ScenePerson:
    """A person who stands and looks at a point."""

    name: str  # of the person
    # x, y, z: position of the feet, metres
    x: float
    y: float
    z: float
    looks_at: tuple[float, float, float]  # the point, metres

    @property
    def eyes(self) -> tuple[float, float, float]:
        """The position of the eyes: 12 cm ahead, so that the body is not in view."""
        ahead = np.array([self.looks_at[0] - self.x, self.looks_at[1] - self.y])
        x, y = (self.x, self.y) + 0.12 * ahead / max(float(np.linalg.norm(ahead)), 1e-9)
        return float(x), float(y), self.z + EYES

    @property
    def body(self) -> VisibleObject:
        """The body, a capsule with a head, 1.75 m high."""
        trunk = capsule(height=1.1, radius=0.19, count=(24, 12))
        trunk.apply_translation((self.x, self.y, self.z - trunk.bounds[0][2]))
        head = icosphere(2, radius=0.12)
        head.apply_translation((self.x, self.y, self.z + EYES + 0.03))
        triangles = np.concatenate([trunk.triangles, head.triangles])
        return VisibleObject(self.name, "person", np.asarray(triangles, np.float64))


class SyntheticScene:
    """Objects, and people with bodies, at a time.

    `triangles` (F, 3, 3) are those of all, metres; `owner` (F,) is the index of each one's object.
    """

    def __init__(
        self,
        objects: Sequence[VisibleObject],
        people: Sequence[ScenePerson],
        time: datetime,
    ) -> None:
        self.objects = [*objects, *(person.body for person in people)]
        self.people = tuple(people)
        self.time = time
        counts = [len(each.triangles) for each in self.objects]
        self.owner = np.repeat(np.arange(len(self.objects)), counts)
        parts = [each.triangles for each in self.objects]
        self.triangles: Floats = np.concatenate([np.zeros((0, 3, 3)), *parts])

    def image(
        self,
        eye: ArrayLike,
        target: ArrayLike,
        size: tuple[int, int] = (640, 480),
        *,
        field: float = math.radians(60),
        label: Callable[[VisibleObject], str] = lambda each: each.type,
    ) -> Segmentation:
        """Return the labelled depth image of a camera at `eye` towards `target`, (3,) metres.

        `size` is in pixels, `field` the horizontal field of view in radians; labels are types by
        default.
        """
        camera = _camera(eye, target, size, field)
        depth, face = camera.image(self.triangles)
        named = [label(each) for each in self.objects]
        number = {name: i for i, name in enumerate(dict.fromkeys(named), 1)}
        table = np.array([number[name] for name in named] or [0], np.int32)
        labels = np.zeros(face.shape, np.int32)
        labels[face >= 0] = table[self.owner[face[face >= 0]]]
        names = {i: name for name, i in number.items()}
        return Segmentation(depth, labels, names, camera.intrinsics, camera.pose, self.time)

    def image_of_people(self, image: Segmentation) -> Segmentation:
        """Return an image whose labels are names of objects with the labels of people alone."""
        names = {person.name for person in self.people}
        kept = {i: name for i, name in image.names.items() if name in names}
        labels = np.where(np.isin(image.labels, [*kept]), image.labels, 0)
        return Segmentation(image.depth, labels, kept, image.intrinsics, image.pose, image.time)

    def gazes(self) -> Gaze:
        """Return where the people look."""
        poses = {person.name: look_at(person.eyes, person.looks_at) for person in self.people}
        return Gaze(poses, self.time)

    def motions(self) -> People:
        """Return where the people stand."""
        motions = {}
        for each in self.people:
            yaw = math.atan2(each.looks_at[1] - each.y, each.looks_at[0] - each.x)
            motions[each.name] = PersonMotion(each.x, each.y, yaw, z=each.z)
        return People(motions, self.time)


def standpoints(scene: SyntheticScene, target: str, floor: float) -> list[tuple[float, float]]:
    """Return places (x, y) from which a person can see an object, the best view first; metres.

    No object is within 0.3 m of a place from knee to head; places are more than 0.8 m apart.
    """
    (wanted,) = [each for each in scene.objects if each.name == target]
    middle = wanted.triangles.reshape(-1, 3).mean(axis=0)
    number = scene.objects.index(wanted)
    low, high = scene.triangles.min(axis=1), scene.triangles.max(axis=1)
    found: list[tuple[int, float, float]] = []
    for angle in np.arange(24) * 2 * math.pi / 24:
        for away in (1.6, 1.12, 2.08):  # metres
            x, y = middle[:2] + away * np.array([math.cos(angle), math.sin(angle)])
            near = (low[:, 0] < x + 0.3) & (high[:, 0] > x - 0.3)
            near &= (low[:, 1] < y + 0.3) & (high[:, 1] > y - 0.3)
            near &= (low[:, 2] < floor + 1.7) & (high[:, 2] > floor + 0.4)
            if near.any():
                continue
            camera = _camera((x, y, floor + EYES), middle, (160, 120), math.radians(30))
            _, face = camera.image(scene.triangles)
            pixels = int((scene.owner[face[face >= 0]] == number).sum())
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
