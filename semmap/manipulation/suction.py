"""A suction cup at a surface: where its lip is tight, and how heavy an object it holds up.

As Mahler et al., "Dex-Net 3.0: Computing robust vacuum suction grasp targets in point clouds using
a new analytic model and deep learning", 2018: the lip is an elastic ring. It is tight if it follows
the surface by bending no further than it can, and it holds a weight if friction and the pressure on
the ring resist it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semmap.arrays import Floats
from semmap.manipulation.error import ManipulationError

PRESSURE = 60e3
"""Pascals between inside and outside of a cup whose force nobody states."""

GIVE = 0.1
"""How far the lip bends to follow a surface, as a share of its diameter (Dex-Net: 10 %)."""

ROOM = 0.3
"""How far a surface bulges into a cup, or is hollow before it, as a share of its radius."""

AROUND = 24
"""Points of the ring at which the height of a surface is looked at."""

FINE = 0.004
"""Metres between points within the ring: a wider hole is found."""


@dataclass(frozen=True)
class Cup:
    """A suction cup: the `radius` of its lip, metres, and the `force` of its vacuum, newtons."""

    radius: float
    force: float

    def __post_init__(self) -> None:
        """ManipulationError where a number is not above 0."""
        for name, unit in (("radius", "metres"), ("force", "newtons")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ManipulationError(
                    f"the {name} of the suction cup is {value}: give {unit} above 0"
                )

    @classmethod
    def of(cls, radius: float, force: float | None = None) -> Cup:
        """A cup of a radius in metres, whose force is by default that of `PRESSURE` on its area."""
        return cls(radius, PRESSURE * math.pi * radius**2 if force is None else force)

    @property
    def give(self) -> float:
        """Metres between the highest and the lowest point of a ring that the lip still follows."""
        return GIVE * 2 * self.radius

    @property
    def room(self) -> float:
        """Metres that a surface may be in front of the lip's plane, or behind it, inside of it."""
        return ROOM * self.radius

    @property
    def soft(self) -> float:
        """Metres behind the plane of the lip that are soft, and give way to an object."""
        return self.give + self.room

    @cached_property
    def ring(self) -> Floats:
        """(`AROUND`, 2) points of the lip in its plane, metres."""
        return _circle(self.radius, AROUND)

    @cached_property
    def inside(self) -> Floats:
        """(M, 2) points within the lip, no farther from each other than some `FINE`, metres."""
        count = max(2, math.ceil(self.radius / FINE))
        rings = [self.radius * k / count for k in range(1, count)]
        circles = (_circle(r, max(6, math.ceil(2 * math.pi * r / FINE))) for r in rings)
        return np.concatenate([np.zeros((1, 2)), *circles])


def _circle(radius: float, count: int) -> Floats:
    angle = np.arange(count) * 2 * np.pi / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def tightness(cup: Cup, ring: Floats, inside: Floats) -> Floats:
    """(...) the share of the lip's give that is left at a surface; 0 where it is not tight.

    Parameters
    ----------
    ring, inside : (..., K) and (..., M) how far the surface is in the direction of the approach, at
        the points of the cup; infinite where there is none, metres

    Notes
    -----
    A ring across a cylinder of radius R has heights from 0 to R - sqrt(R² - r²); on a sphere, all
    are equal, and the sphere is that far inside of the cup.
    """
    low, high = ring.min(axis=-1), ring.max(axis=-1)
    with np.errstate(invalid="ignore"):  # nothing is there: inf - inf
        left = 1 - (high - low) / cup.give
        off = np.maximum(low - inside.min(axis=-1), inside.max(axis=-1) - high)
    tight = np.isfinite(high) & np.isfinite(off) & (off <= cup.room)
    share: Floats = np.where(tight, np.clip(left, 0, 1), 0.0)
    return share


def heaviest(cup: Cup, down: Floats, lever: Floats, friction: float) -> Floats:
    """(N,) the weights, newtons, up to which a cup holds objects.

    Parameters
    ----------
    down, lever : (N, 3) the direction of gravity, and the way from the middle of the lip to the
        centre of mass, metres, both in the grasp frame (+z into the object)
    friction : coefficient between lip and object

    Notes
    -----
    With the force V of the vacuum, a weight W along g at c presses the ring of radius r on by
    N = V - W g_z. It holds if W (|g_xy| + |(c x g)_z| / r) <= friction N, since the wrenches that
    friction resists are convex, and if W |(c x g)_xy| <= r N / 2: where a moment bends an elastic
    ring more, its pressure N / (2 pi r) + M cos / (pi r²) is below 0 at one side, and it leaks.
    """
    moment = np.cross(lever, down)
    along = np.hypot(down[:, 0], down[:, 1])
    slip = along + np.abs(moment[:, 2]) / cup.radius + friction * down[:, 2]
    tilt = np.hypot(moment[:, 0], moment[:, 1]) + cup.radius * down[:, 2] / 2
    limits = np.stack(
        [
            friction * cup.force / np.maximum(slip, 1e-12),
            cup.radius * cup.force / 2 / np.maximum(tilt, 1e-12),
        ]
    )
    most: Floats = np.where(np.stack([slip, tilt]) > 1e-12, limits, np.inf).min(axis=0)
    return most


def strain(cup: Cup, force: Floats, moment: Floats, friction: float) -> float:
    """How much of what a cup resists a load takes: above 1, it lets go.

    `force` and `moment` (3,), newtons and newton metres, act from the object on the cup, at the
    middle of the lip and in the grasp frame. As `heaviest`.
    """
    pressed = cup.force - float(force[2])
    if pressed <= 0:
        return math.inf
    slip = math.hypot(force[0], force[1]) + abs(float(moment[2])) / cup.radius
    tilt = math.hypot(moment[0], moment[1])
    return max(slip / (friction * pressed), 2 * tilt / (cup.radius * pressed))
