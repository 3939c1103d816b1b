"""Grasps of any surface by a suction cup: where its lip is tight, the best first.

The surface is known as triangles. At each point of it, rays along the normal tell how high it is
below the lip and within, as the cup sees it; there, the cup comes straight along the normal.
"""

from __future__ import annotations

import numpy as np

from semmap.arrays import Floats
from semmap.manipulation.candidates import Grasps, grasp_names
from semmap.manipulation.collision import Obstacles
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.suction import Cup, tightness
from semmap.manipulation.surface_grasps import SampledSurface, first_free, from_all_sides

SEEDS = 400
"""Points at which a cup is tried, at random."""

NEAREST = 100
"""Points at which it is tried as well: those whose normal passes nearest to the centre of mass."""

SPOTS = 60
"""The most points of a surface at which the cup is put."""

TURNS = 4
"""Turns of the hand about its approach at each point."""

OFF = 0.005
"""Metres by which a robot may be wrong along the surface, and the lip should still be tight."""

FEW = 3
"""Every so many points of the ring are looked at first."""

SIDES = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
"""Directions in which it may be wrong."""

STRAIGHT = np.cos(np.radians(5))
"""The cosine to an axis of the object's shape at which the cup comes along that axis."""

EDGE = 1e-6
"""The cosine between approach and normal below which a triangle is seen from its edge."""


def suction_grasps(
    surface: SampledSurface,
    gripper: Gripper,
    triangles: Floats,
    *,
    frame: Floats | None = None,
    distance: float = 0.1,
    either_side: bool = False,
) -> Grasps:
    """The grasps of a surface by a suction cup, from all sides, at `SPOTS` points at most.

    Parameters
    ----------
    surface : in the frame of the model, with normals that lead out of the object
    triangles : (F, 3, 3) of the object: what the lip is on, and what the rest does not touch
    frame : (4, 4) of the object's shape in that of the model; approaches are named by its axes
    distance : metres between pre-grasp and grasp
    either_side : the normals may lead into the object, too

    Notes
    -----
    The quality is the geometric mean of three shares: the give of the lip that is left
    (`tightness`); of the same 5 mm aside, of which it is tight in so many of four directions; and
    the nearness of the approach to the centre of mass, by the surface's radius. Which weight it
    holds depends on how the object stands (`steadiness`).

    Raises
    ------
    ManipulationError
        The library for collisions is not installed: nothing tells what the stiff part meets.
    """
    cup = gripper.cup
    assert cup is not None
    frame = np.eye(4) if frame is None else frame
    points, normals = _seeds(surface)
    if either_side:
        points, normals = np.concatenate([points, points]), np.concatenate([normals, -normals])
    rotations = _frames(-normals, frame[:3, :3])
    around = Obstacles(triangles)
    found = np.array(
        [_seal(cup, around, p, r) for p, r in zip(points, rotations, strict=True)]
    ).reshape(-1, 3)
    lever = np.cross(surface.centre - points, rotations[:, :, 2])
    centring = 1 - np.linalg.norm(lever, axis=1) / surface.radius
    shares = np.column_stack([found[:, :2], np.clip(centring, 0, 1)])
    quality = np.where(found[:, 0] > 0, np.prod(shares, axis=1) ** (1 / 3), 0.0)
    order = np.argsort(-quality, kind="stable")
    order = order[quality[order] > 0]
    chosen = order[
        from_all_sides(rotations[order], points[order], np.zeros(len(order), bool), False)
    ]
    poses = np.tile(np.eye(4), (len(chosen), 1, 1))
    poses[:, :3, :3] = rotations[chosen]
    poses[:, :3, 3] = points[chosen] + found[chosen, 2, None] * rotations[chosen, :, 2]
    grasps = _turned(gripper, poses, quality[chosen], frame, distance)
    return Grasps.joined([grasps[first_free(grasps, around, SPOTS * TURNS)]])


def _seeds(surface: SampledSurface) -> tuple[Floats, Floats]:
    """Points (N, 3) and unit normals (N, 3) at random, and some beside the centre of mass."""
    points, normals = surface.points, surface.normals
    random = np.random.default_rng(0)
    some = random.choice(len(points), min(SEEDS, len(points)), replace=False)
    lever = np.linalg.norm(np.cross(surface.centre - points, normals), axis=1)
    sides = np.unique(np.round(normals), axis=0, return_inverse=True)[1].ravel()
    near = [
        np.flatnonzero(sides == side)[np.argsort(lever[sides == side])[: NEAREST // 6]]
        for side in np.unique(sides)
    ]
    chosen = np.unique(np.concatenate([some, *near]))
    return points[chosen], normals[chosen]


def _frames(approaches: Floats, axes: Floats) -> Floats:
    """(N, 3, 3) frames along approaches (N, 3), or along the axis of the shape that is near."""
    along = approaches @ axes
    rows, axis = np.arange(len(along)), np.argmax(np.abs(along), axis=1)
    straight = np.abs(along[rows, axis]) > STRAIGHT
    on_axis = np.sign(along[rows, axis])[:, None] * axes.T[axis]
    z = np.where(straight[:, None], on_axis, approaches)
    x = axes.T[(axis + 1) % 3]
    x = x - np.einsum("ni,ni->n", x, z)[:, None] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _seal(cup: Cup, around: Obstacles, point: Floats, rotation: Floats) -> tuple[float, ...]:
    """How tight a cup is at a point, the share of places beside it, and the lip's height, metres.

    The height is the middle between those of the highest and the lowest point of the ring.
    """
    reach = cup.radius + OFF + cup.soft
    near = (around.within(point - reach, point + reach).triangles - point) @ rotation
    some = heights(near, cup.ring[::FEW], -cup.soft)
    if not some.max() < some.min() + cup.give:  # most places are settled so, or nothing is there
        return 0.0, 0.0, 0.0
    here = _lip_heights(cup, near, np.zeros((1, 2)))
    (tight,) = tightness(cup, *here)
    if not tight:
        return 0.0, 0.0, 0.0
    aside = tightness(cup, *_lip_heights(cup, near, OFF * SIDES))
    share = (1 + np.count_nonzero(aside)) / (1 + len(SIDES))
    return float(tight), share, float(here[0].min() + here[0].max()) / 2


def _lip_heights(cup: Cup, triangles: Floats, moves: Floats) -> tuple[Floats, Floats]:
    """Heights (N, K) below the ring and (N, M) below what is inside of it, for N moves aside."""
    rays = moves[:, None] + np.concatenate([cup.ring, cup.inside])
    seen = heights(triangles, rays.reshape(-1, 2), -cup.soft).reshape(rays.shape[:2])
    return seen[:, : len(cup.ring)], seen[:, len(cup.ring) :]


def heights(triangles: Floats, at: Floats, lowest: float = -np.inf) -> Floats:
    """(K,) the least z, from `lowest` on, of triangles (T, 3, 3) at points `at` (K, 2).

    Infinite where there is no triangle.
    """
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    met = (low[:, :2] <= at.max(axis=0)) & (high[:, :2] >= at.min(axis=0))
    a, b, c = np.moveaxis(triangles[met.all(axis=1) & (high[:, 2] >= lowest)], 1, 0)
    u, v = b - a, c - a
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    seen = np.abs(area) > EDGE * np.linalg.norm(np.cross(u, v), axis=1)
    a, u, v, area = a[seen], u[seen], v[seen], area[seen]
    x, y = (at[:, axis, None] - a[:, axis] for axis in (0, 1))
    s = (x * v[:, 1] - y * v[:, 0]) / area
    t = (y * u[:, 0] - x * u[:, 1]) / area
    z = a[:, 2] + s * u[:, 2] + t * v[:, 2]
    little = 1e-9  # on the edge between two triangles, both are met
    met = (s >= -little) & (t >= -little) & (s + t <= 1 + little) & (z >= lowest)
    found: Floats = np.where(met, z, np.inf).min(axis=1, initial=np.inf)
    return found


def _turned(
    gripper: Gripper, poses: Floats, quality: Floats, frame: Floats, distance: float
) -> Grasps:
    """Grasps at poses (N, 4, 4), to which the cup comes straight, each with `TURNS` of the hand."""
    angle = np.tile(np.arange(TURNS) * 2 * np.pi / TURNS, len(poses))
    turn = np.tile(np.eye(4), (len(angle), 1, 1))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0] = np.sin(angle)
    turn[:, 0, 1] = -turn[:, 1, 0]
    poses = np.repeat(poses, TURNS, axis=0) @ turn
    before = poses.copy()
    before[:, :3, 3] -= distance * poses[:, :3, 2]
    none, kind = np.zeros(len(poses), np.intp), np.full(len(poses), "cup")
    names, families = grasp_names(frame[:3, :3].T @ poses[:, :3, :3], none, kind, "xyz")
    widths = np.full(len(poses), gripper.opening)
    return Grasps(gripper, poses, before, widths, np.repeat(quality, TURNS), names, families)
