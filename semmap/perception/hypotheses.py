"""Rough shapes from few points with normals, many at once; the best by a truncated cost.

Two points with normals give a sphere or cylinder, three a cone, two perpendicular normals the frame
of a cuboid (Schnabel and others, "Efficient RANSAC for Point-Cloud Shape Detection", 2007).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import cdist

from semmap.perception.fitted_shapes import Placed
from semmap.perception.point_cloud import Floats, Surfels

TRIES = 120  # hypotheses of each kind
SCORED = 200  # points that score them
SLIMMEST, WIDEST = 0.09, 5.7  # slopes of cones: 5 and 80 degrees from the axis


def hypotheses(
    cloud: Surfels, scale: float, up: Floats | None, random: np.random.Generator
) -> list[Placed]:
    """Return rough shapes of each kind that the points suggest, about a likely axis `up`.

    From a distance of `scale` metres on, all outliers cost the same.
    """
    points, normals = cloud.points, cloud.normals
    chosen = random.permutation(len(points))[:SCORED]
    sample, sampled_normals = points[chosen], normals[chosen]
    widest = float(np.linalg.norm(np.ptp(points, axis=0)))
    known = _faces_of(sampled_normals, random)
    triple = random.integers(0, len(points), (TRIES, 3))
    side = np.flatnonzero(np.abs(normals @ known[0]) < 0.9)
    if len(side) > 0.1 * len(points):  # curved sides beside a large flat end
        triple[::2] = side[random.integers(0, len(side), (len(triple[::2]), 3))]
    p, n = points[triple], normals[triple]
    if up is not None:
        known = np.vstack([up, known])
    found = [
        _sphere(p, n, sample, scale, widest),
        *_cylinders(p, n, sample, sampled_normals, scale, widest, known),
        _cone(p, n, sample, scale, widest),
        _disk(sample, sampled_normals, known[0]),
        *_cuboids(n, sample, sampled_normals, scale, known),
    ]
    return [shape for shape in found if shape is not None]


def frame_with_axis(axis: Floats) -> Floats:
    """Return a rotation whose third column is a unit vector."""
    a, b, c = axis.tolist()
    least = min(abs(a), abs(b), abs(c))
    x = (0, -c, b) if abs(a) == least else (c, 0, -a) if abs(b) == least else (-b, a, 0)
    u, v, w = (number / math.hypot(*x) for number in x)
    return np.array([[u, b * w - c * v, a], [v, c * u - a * w, b], [w, a * v - b * u, c]])


def smallest_box(points: Floats, axis: Floats) -> tuple[Floats, float]:
    """Return the frame of the smallest box along an axis, and the filled share of its rectangle."""
    upright = frame_with_axis(axis)
    flat = (points @ upright)[:, :2]
    try:
        hull = ConvexHull(flat)
    except QhullError:
        return upright, 1.0
    corners = flat[hull.vertices]
    edge = np.roll(corners, -1, axis=0) - corners
    heading = np.arctan2(edge[:, 1], edge[:, 0]) % (np.pi / 2)
    cos, sin = np.cos(heading), np.sin(heading)
    u = cos[:, None] * corners[:, 0] + sin[:, None] * corners[:, 1]
    v = cos[:, None] * corners[:, 1] - sin[:, None] * corners[:, 0]
    area = np.ptp(u, axis=1) * np.ptp(v, axis=1)
    best = int(area.argmin())
    turn = np.array([[cos[best], -sin[best], 0], [sin[best], cos[best], 0], [0, 0, 1]])
    return upright @ turn, float(hull.volume / max(area[best], 1e-12))


def _faces_of(normals: Floats, random: np.random.Generator) -> Floats:
    """The two directions that most normals have, (2, 3), the second one not like the first."""
    tried = normals[random.integers(0, len(normals), min(40, len(normals)))]
    along = np.abs(tried @ normals.T)
    first = int((along > 0.97).sum(axis=1).argmax())
    same = along[first] > 0.97
    other = np.where(np.abs(tried @ tried[first]) > 0.9, -1, ((along > 0.97) & ~same).sum(axis=1))
    second = int(other.argmax())
    found = [_principal(normals[same]), _principal(normals[along[second] > 0.97])]
    return np.array(found)


def _principal(normals: Floats) -> Floats:
    """The mean axis of unit vectors of arbitrary signs."""
    return np.asarray(np.linalg.eigh(normals.T @ normals)[1][:, -1])


def _best(cost: Floats, usable: NDArray[np.bool_]) -> int | None:
    """The row of least mean cost; None if no row is usable."""
    total = np.where(usable, cost.mean(axis=1), np.inf)
    best = int(total.argmin())
    return best if np.isfinite(total[best]) else None


def _meeting_points(p: Floats, n: Floats, q: Floats, m: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """The points (h, 3) nearest to pairs of lines, and whether the lines are not parallel."""
    apart = q - p
    cos = np.einsum("hi,hi->h", n, m)
    sin2 = 1 - cos**2
    usable = sin2 > 0.03
    sin2 = np.where(usable, sin2, 1)
    along_n, along_m = np.einsum("hi,hi->h", apart, n), np.einsum("hi,hi->h", apart, m)
    s, t = (along_n - cos * along_m) / sin2, (cos * along_n - along_m) / sin2
    return (p + s[:, None] * n + q + t[:, None] * m) / 2, usable


def _along_and_across(sample: Floats, centre: Floats, axis: Floats) -> tuple[Floats, Floats]:
    """Coordinates along h axes, and distances from them, of s points: (h, s) each."""
    along = axis @ sample.T - np.einsum("hi,hi->h", axis, centre)[:, None]
    return along, np.sqrt(np.maximum(cdist(centre, sample, "sqeuclidean") - along**2, 0))


def _sphere(p: Floats, n: Floats, sample: Floats, scale: float, widest: float) -> Placed | None:
    centre, usable = _meeting_points(p[:, 0], n[:, 0], p[:, 1], n[:, 1])
    radius = np.linalg.norm(p[:, :2] - centre[:, None], axis=2).mean(axis=1)
    distance = cdist(centre, sample) - radius[:, None]
    cost = np.minimum((distance / scale) ** 2, 1)
    best = _best(cost, usable & (radius < widest))
    if best is None:
        return None
    return Placed("sphere", np.eye(3), centre[best], radius[best, None])


def _cylinders(
    p: Floats,
    n: Floats,
    sample: Floats,
    normals: Floats,
    scale: float,
    widest: float,
    known: Floats,
) -> list[Placed | None]:
    """The best cylinder by its side; and the best along the normal of the largest plane."""
    axis = np.cross(n[:, 0], n[:, 1])
    axis[::2] = known[np.arange(len(axis[::2])) % len(known)]
    length = np.linalg.norm(axis, axis=1)
    usable = length > 0.17
    axis /= np.maximum(length, 1e-12)[:, None]
    flat_p = p[:, :2] - np.einsum("hki,hi->hk", p[:, :2], axis)[:, :, None] * axis[:, None]
    flat_n = n[:, :2] - np.einsum("hki,hi->hk", n[:, :2], axis)[:, :, None] * axis[:, None]
    slant = np.linalg.norm(flat_n, axis=2)
    usable &= (slant > 0.7).all(axis=1)
    flat_n /= np.maximum(slant, 1e-12)[:, :, None]
    centre, crossing = _meeting_points(flat_p[:, 0], flat_n[:, 0], flat_p[:, 1], flat_n[:, 1])
    radius = np.linalg.norm(flat_p - centre[:, None], axis=2).mean(axis=1)
    usable &= crossing & (radius < widest)
    _, rho = _along_and_across(sample, centre, axis)
    on_side = np.minimum(((rho - radius[:, None]) / scale) ** 2, 1)
    # Points inside, whose normal is along the axis, are of an end.
    is_end = (np.abs(axis @ normals.T) > 0.9) & (rho < radius[:, None] + scale)
    best = _best(np.where(is_end, np.minimum(on_side, 0.3), on_side), usable)
    if best is None:
        return []
    frame = frame_with_axis(axis[best])
    return [Placed("cylinder", frame, centre[best], np.array([radius[best], 0.0, 0.0]))]


def _disk(sample: Floats, normals: Floats, axis: Floats) -> Placed | None:
    """The end of a cylinder that fills the largest plane."""
    frame = frame_with_axis(axis)
    local = sample[np.abs(normals @ axis) > 0.95] @ frame
    if not len(local):
        return None
    local = local[np.abs(local[:, 2] - np.median(local[:, 2])) < 0.1 * np.ptp(sample)]
    if len(local) < 10:
        return None
    middle = np.median(local, axis=0)
    radius = np.sqrt(2 * np.square(local[:, :2] - middle[:2]).sum(axis=1).mean())
    return Placed("cylinder", frame, frame @ middle, np.array([radius, 0.0, 0.0]))


def _cone(p: Floats, n: Floats, sample: Floats, scale: float, widest: float) -> Placed | None:
    """The tangent planes of three points meet at the tip."""
    volume = np.linalg.det(n)
    usable = np.abs(volume) > 0.02
    planes = np.where(usable[:, None, None], n, np.eye(3))
    tip = np.linalg.solve(planes, np.einsum("hki,hki->hk", n, p)[:, :, None])[:, :, 0]
    line = p - tip[:, None]
    length = np.linalg.norm(line, axis=2, keepdims=True)
    usable &= (length[:, :, 0] > scale).all(axis=1) & (length[:, :, 0] < 2 * widest).all(axis=1)
    line /= np.maximum(length, 1e-12)
    axis = np.cross(line[:, 1] - line[:, 0], line[:, 2] - line[:, 0])
    norm = np.linalg.norm(axis, axis=1)
    usable &= norm > 0.01
    axis /= np.maximum(norm, 1e-12)[:, None]
    cos = np.einsum("hki,hi->hk", line, axis).mean(axis=1)
    axis *= -np.sign(cos)[:, None]  # towards the tip
    cos = np.clip(np.abs(cos), 1e-3, 1)
    tangent = np.sqrt(1 - cos**2) / cos
    usable &= (tangent > SLIMMEST) & (tangent < WIDEST)
    along, rho = _along_and_across(sample, tip, axis)
    distance = cos[:, None] * (rho + tangent[:, None] * along)
    best = _best(np.minimum((distance / scale) ** 2, 1), usable)
    if best is None:
        return None
    frame = frame_with_axis(axis[best])
    return Placed("cone", frame, tip[best], np.array([tangent[best], 0.0, 0.0]))


def _cuboids(
    n: Floats, sample: Floats, normals: Floats, scale: float, known: Floats
) -> list[Placed]:
    """The frame that most normals agree with; and the smallest rectangles along known axes."""
    first, second = n[: TRIES // 2, 0], n[: TRIES // 2, 1]
    second = second - np.einsum("hi,hi->h", first, second)[:, None] * first
    length = np.linalg.norm(second, axis=1)
    usable = length > 0.95
    second /= np.maximum(length, 1e-12)[:, None]
    third = np.cross(first, second)
    frame = np.stack([first, second, third], axis=2)
    along = np.maximum(np.abs(first @ normals.T), np.abs(second @ normals.T))
    along = np.maximum(along, np.abs(third @ normals.T))
    best = _best(np.minimum((1 - along) / 0.05, 1), usable)
    frames = [] if best is None else [frame[best]]
    frames += [smallest_box(sample, axis)[0] for axis in known]
    # The frames that most normals are along: two, as a rectangle may fit where normals are few.
    frames.sort(key=lambda f: -float((np.abs(normals @ f).max(axis=1) > 0.95).mean()))
    few = len(sample) // 50
    return [
        Placed("cuboid", f, np.zeros(3), np.sort(sample @ f, axis=0)[[few, -1 - few]].ravel())
        for f in frames[:2]
    ]
