"""A rough shape refined to the points: robust least squares on the faces that the points show.

The iteration is Gauss-Newton with weights, written out: `scipy.optimize.least_squares` takes 10 ms
a shape, as it decomposes the whole Jacobian in each step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from semmap.perception.hypotheses import Placed
from semmap.perception.plane import Plane
from semmap.perception.point_cloud import Floats, Surfels
from semmap.perception.shapes import face_distances, face_normals, face_slopes, size_gradient

__all__ = ["Fit", "refined"]

STANDS = math.cos(math.radians(15))
"""An end that is level within 15 degrees stands on the table."""

TABLE_DEVIATION = 1e-3
"""Of the height of a table, metres."""

WINDOW = 6
"""Widths over which the density beside an edge is counted: more for a steadier count."""

ROUGH, FINE = (2, 0.3), (4, 0.02)
"""The most steps of an iteration, and the part of the noise below which a step is the last."""

ENDS: dict[str, tuple[tuple[int, int, int, int], ...]] = {
    "sphere": (),
    "cylinder": ((1, 1, 2, -1), (2, 2, 2, 1)),
    "cone": ((1, 1, 2, -1),),
    "cuboid": tuple((3 * k + i, 3 * k + i, i, 2 * k - 1) for k in range(2) for i in range(3)),
}
"""The flat faces: number of the face, of its bound, the axis across, and the side of it."""


OPPOSITE = {
    "sphere": (),
    "cylinder": ((1, 2),),
    "cone": (),
    "cuboid": ((0, 3), (1, 4), (2, 5)),
}
"""Flat faces of which a thin view could be either."""


class Fit(NamedTuple):
    """A refined shape.

    Attributes
    ----------
    placed : the shape
    seen : (faces,) bool, which faces have points
    deviation : standard deviations of the sizes, metres; infinite for those that are not seen
    """

    placed: Placed
    seen: NDArray[np.bool_]
    deviation: Floats

    def local(self, points: Floats) -> Floats:
        """Return points (n, 3) in the frame of the shape."""
        return np.asarray((points - self.placed.origin) @ self.placed.rotation)


class _End(NamedTuple):
    """What is known about a bound that no points are on."""

    face: int
    bound: int
    value: float
    deviation: float


def refined(
    shape: Placed,
    cloud: Surfels,
    whole: Floats,
    noise: float,
    table: Plane | None,
    turns: int = 2,
) -> Fit | None:
    """Return a rough shape fitted to the points, or None if they show none of its faces.

    Parameters
    ----------
    cloud
        Points that are fitted.
    whole
        (n, 3) all points, which tell where edges are.
    noise
        Standard deviation of the points, metres.
    table
        The plane that the object stands on, if known.
    turns
        How often the faces that are seen are determined; with 1, the fit is a rough one.
    """
    kind, rotation, origin, bounds = shape
    scale = max(2 * noise, 0.02 * float(np.linalg.norm(np.ptp(cloud.points, axis=0))))
    if kind in ("cylinder", "cone"):
        bounds = _first_ends(shape, cloud, scale)
    steps, end = ROUGH if turns == 1 else FINE
    for turn in range(turns):
        placed = Placed(kind, rotation, origin, bounds)
        seen = _seen_faces(placed, cloud, scale)
        if not seen.any():
            return None
        for _ in range(steps):
            rows, residual, weights = _equations(placed, cloud, seen, scale)
            normal = (rows * weights[:, None]).T @ rows
            normal[np.diag_indices_from(normal)] += 1e-7 * np.trace(normal) + 1e-12
            step = np.asarray(-np.linalg.solve(normal, rows.T @ (weights * residual)), float)
            placed = _moved(placed, step)
            if np.abs(step).max() < end * noise:
                break
        scale = min(scale, max(noise, 1.48 * float(np.median(np.abs(residual)))))
        points = whole if turn == turns - 1 else cloud.points
        spacing = cloud.spacing * math.sqrt(len(cloud.points) / len(points))
        placed, ends = _ended(placed, seen, points, spacing, noise, table)
        _, rotation, origin, bounds = placed
        if not np.isfinite(bounds).all() or np.abs(bounds).max() > 1e3:
            return None
    known = normal / noise**2
    return Fit(placed, seen, _deviation(placed, known, ends))


def _local(placed: Placed, cloud: Surfels) -> tuple[Floats, Floats]:
    return (cloud.points - placed.origin) @ placed.rotation, cloud.normals @ placed.rotation


def _first_ends(shape: Placed, cloud: Surfels, scale: float) -> Floats:
    """Bounds along the axis from the points near the shape."""
    points, _ = _local(shape, cloud)
    tangent = shape.bounds[0]
    if shape.kind == "cone":
        reach = np.hypot(points[:, 0], points[:, 1]) < tangent * -points[:, 2] + 3 * scale
        z = points[reach, 2]
        return np.array([tangent, np.quantile(z, 0.01) if len(z) else -1e-3, 0.0])
    z = points[np.hypot(points[:, 0], points[:, 1]) < tangent + 3 * scale, 2]
    low, high = np.quantile(z, (0.01, 0.99)) if len(z) else (0.0, 0.0)
    return np.array([tangent, low, high])


def _seen_faces(placed: Placed, cloud: Surfels, scale: float) -> NDArray[np.bool_]:
    """(faces,) whether a face has points on it with normals across it."""
    points, normals = _local(placed, cloud)
    distances = face_distances(placed.kind, points, placed.bounds)
    own = distances.argmax(axis=0)
    outward = face_normals(placed.kind, points, placed.bounds, own)
    across = np.abs(np.einsum("ni,ni->n", outward, normals))
    on = (np.abs(distances[own, np.arange(len(points))]) < 3 * scale) & (across > 0.85)
    count = np.bincount(own[on], minlength=len(distances))
    seen = np.asarray(count >= max(10, 0.02 * len(points)))
    for low, high in OPPOSITE[placed.kind]:
        thickness = placed.bounds[high] - placed.bounds[low]
        if seen[low] and seen[high] and thickness < 4 * scale:
            seen[low if count[low] < count[high] else high] = False
    return seen


def _equations(
    placed: Placed, cloud: Surfels, seen: NDArray[np.bool_], scale: float
) -> tuple[Floats, Floats, Floats]:
    """The Jacobian (n, 6 + bounds), the residuals and weights (n,) of the points.

    The first six columns are a motion of the shape in its own frame: translation, rotation vector.
    """
    points, normals = _local(placed, cloud)
    own, residual = _nearest(placed.kind, points, placed.bounds, seen)
    normal = face_normals(placed.kind, points, placed.bounds, own)
    across = np.einsum("ni,ni->n", normal, normals)
    weights = across**4 / (1 + (residual / (2 * scale)) ** 2) ** 2
    rows = np.empty((len(points), 6 + len(placed.bounds)))
    x, y, z = points.T
    a, b, c = normal.T
    rows[:, :3], rows[:, 6:] = -normal, face_slopes(placed.kind, points, placed.bounds, own)
    rows[:, 3], rows[:, 4], rows[:, 5] = z * b - y * c, x * c - z * a, y * a - x * b
    return rows, residual, weights


def _nearest(
    kind: str, points: Floats, bounds: Floats, seen: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], Floats]:
    """The face of each point among those that are seen, and the distance to it."""
    faces = np.flatnonzero(seen)
    distances = face_distances(kind, points, bounds)[faces]
    nearest = distances.argmax(axis=0)
    return faces[nearest], distances[nearest, np.arange(len(points))]


def _moved(placed: Placed, step: Floats) -> Placed:
    x, y, z = (min(max(angle, -0.5), 0.5) / 2 for angle in step[3:6].tolist())
    half = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    # Cayley's map, a rotation: (1 - half)^-1 (1 + half)
    turn = np.eye(3) + 2 / (1 + x * x + y * y + z * z) * (half + half @ half)
    return placed._replace(
        rotation=placed.rotation @ turn,
        origin=placed.origin + placed.rotation @ step[:3],
        bounds=placed.bounds + step[6:],
    )


def _ended(
    placed: Placed,
    seen: NDArray[np.bool_],
    cloud: Floats,
    spacing: float,
    noise: float,
    table: Plane | None,
) -> tuple[Placed, list[_End]]:
    """The shape with the ends that have no points on them: by the table, by edges, or unknown."""
    kind = placed.kind
    points = (cloud - placed.origin) @ placed.rotation
    ends: list[_End] = []
    if kind == "cylinder" and not seen[0]:
        placed, points, rim = _disk(placed, points, noise)
        ends.append(rim)
    own, distance = _nearest(kind, points, placed.bounds, seen)
    near = np.abs(distance) < 4 * noise
    across = {e[0]: e[2] for e in ENDS[kind]}
    axis_of = np.array([across.get(face, -1) for face in range(len(seen))])[own]
    bounds = placed.bounds.copy()
    for face, bound, axis, side in ENDS[kind]:
        if seen[face]:
            continue
        outward = side * placed.rotation[:, axis]
        along = side * points[near & (axis_of != axis), axis]
        if table is not None and outward @ table.normal < -STANDS:
            middle = placed.rotation @ _middle(kind, bounds) + placed.origin
            down = table.height(middle[None])[0] / -(outward @ table.normal)
            value, deviation = side * _middle(kind, bounds)[axis] + down, TABLE_DEVIATION
        elif len(along) >= 20:
            value, deviation = _edge(along, 4 * max(noise, spacing), spacing)
        else:
            value, deviation = float((side * points[near, axis]).max(initial=0.0)), math.inf
        bounds[bound] = side * value
        ends.append(_End(face, bound, side * value, deviation))
    return placed._replace(bounds=bounds), ends


def _middle(kind: str, bounds: Floats) -> Floats:
    """A point on the axis of a shape, in its frame."""
    if kind == "cuboid":
        return np.asarray((bounds[:3] + bounds[3:]) / 2)
    return np.array([0, 0, bounds[1:].mean()])


def _disk(placed: Placed, points: Floats, noise: float) -> tuple[Placed, Floats, _End]:
    """A cylinder of which an end alone is seen: its points fill the circle evenly."""
    z = placed.bounds[1:]
    on = np.abs(points[:, 2, None] - z).min(axis=1) < 4 * noise
    if not on.any():
        return placed, points, _End(0, 0, placed.bounds[0], math.inf)
    middle = np.array([*points[on, :2].mean(axis=0), 0.0])
    points = points - middle
    rho2 = np.square(points[on, :2]).sum(axis=1)
    radius = math.sqrt(2 * max(float(rho2.mean()) - 2 * noise**2, 1e-12))
    placed = placed._replace(
        origin=placed.origin + placed.rotation @ middle, bounds=np.array([radius, *z])
    )
    return placed, points, _End(0, 0, radius, radius / math.sqrt(max(int(on.sum()), 1)))


def _edge(along: Floats, width: float, spacing: float) -> tuple[float, float]:
    """Where evenly spread points with noise end, and its standard deviation.

    The points beyond a line are as many as the density inside of it times the distance to the end:
    noise moves as many over the edge as back.
    """
    start, reach = float(along.min()), float(np.ptp(along))
    bins = max(int(reach / width * 2), 1)
    count = np.bincount(((along - start) * (bins / max(reach, 1e-12))).astype(int), minlength=bins)
    count[bins - 1] += count[bins:].sum()
    full = np.flatnonzero(count[:bins] > 0.3 * np.median(count[:bins][count[:bins] > 0]))
    last = start + reach * (int(full[-1]) + 1) / bins  # beyond are outliers
    line = last - width
    inside = along[(along > line - WINDOW * width) & (along <= line)]
    beyond = int(((along > line) & (along < last + width / 2)).sum())
    if len(inside) < 10:
        return last, max(width, spacing)
    density = len(inside) / (line - max(line - WINDOW * width, start))
    counted = math.sqrt(beyond + beyond**2 / len(inside)) / density
    return line + beyond / density, math.hypot(counted, spacing / math.sqrt(12))


def _deviation(placed: Placed, normal: Floats, ends: list[_End]) -> Floats:
    """Standard deviations of the sizes, by the normal equations of points and ends."""
    for face, bound, _, deviation in ends:
        row = np.zeros(len(normal))
        row[6 + bound] = 1
        for number, _, axis, _ in ENDS[placed.kind]:
            if number == face:
                row[axis] = 1
        if math.isfinite(deviation):
            normal += np.outer(row, row) / deviation**2
    normal[np.diag_indices_from(normal)] += 1.0  # no number is less known than to a metre
    gradient = size_gradient(placed.kind, placed.bounds)
    every = np.hstack([np.zeros((len(gradient), 6)), gradient])
    deviation = np.sqrt(np.einsum("ij,ji->i", every, np.linalg.solve(normal, every.T)))
    open_ends = [end.bound for end in ends if math.isinf(end.deviation)]
    return np.where((gradient[:, open_ends] != 0).any(axis=1), math.inf, deviation)
