"""Things that no primitive stands for: a mug, a plate, a ring, and unions of boxes at random."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.random import Generator


def turned(mesh: trimesh.Trimesh, angle: float, axis: tuple[float, ...]) -> trimesh.Trimesh:
    moved = mesh.copy()
    moved.apply_transform(trimesh.transformations.rotation_matrix(angle, axis))
    return moved


def cup(radius: float = 0.045, height: float = 0.1, wall: float = 0.004) -> trimesh.Trimesh:
    """A cup with its bottom at z = 0, open above."""
    outer = trimesh.creation.cylinder(radius, height, sections=48)
    inner = trimesh.creation.cylinder(radius - wall, height, sections=48)
    inner.apply_translation((0, 0, wall))
    made = outer.difference(inner)
    made.apply_translation((0, 0, height / 2))
    return made


def mug() -> trimesh.Trimesh:
    """A cup of 9 cm with a round handle of 1 cm, on the side of +x."""
    handle = turned(trimesh.creation.torus(0.028, 0.005), np.pi / 2, (1, 0, 0))
    handle.apply_translation((0.045, 0, 0.05))
    inner = trimesh.creation.cylinder(0.041, 0.1, sections=48)
    inner.apply_translation((0, 0, 0.054))
    return cup().union(handle).difference(inner)


def plate(radius: float = 0.11, height: float = 0.016) -> trimesh.Trimesh:
    """A flat plate whose rim is 1 cm wide, with its bottom at z = 0."""
    made = trimesh.creation.cylinder(radius, height, sections=64)
    hollow = trimesh.creation.cylinder(radius - 0.01, height, sections=64)
    hollow.apply_translation((0, 0, 0.006))
    made = made.difference(hollow)
    made.apply_translation((0, 0, height / 2))
    return made


def boxes(random: Generator, count: int = 3) -> trimesh.Trimesh:
    """Boxes of 1 to 12 cm that overlap."""
    made = []
    for _ in range(count):
        box = trimesh.creation.box(random.uniform(0.01, 0.12, 3))
        box.apply_translation(random.uniform(-0.04, 0.04, 3))
        made.append(box)
    return made[0].union(made[1:])
