"""The sphere, cylinder, cuboid or cone that fits points best, also if only one side is seen.

RANSAC suggests shapes, iteratively reweighted least squares refine them. An end of a shape is a
face that is seen, the table that the object stands on, or the edge of a face that leads there; else
the deviation of the size is infinite.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from numpy.typing import ArrayLike

import semmap_native
from semmap.perception.fitted_shapes import SHAPES, Fit, Placed, refined, size_of
from semmap.perception.hypotheses import SLIMMEST, WIDEST, hypotheses
from semmap.perception.plane import Plane
from semmap.perception.point_cloud import Floats, PerceptionError, Surfels, checked_points, surfels

FEWEST = 30  # points that a fit needs
FITTED = 800  # points that are fitted: more make the result no better than their common errors
ALONE = 2.0  # points whose neighbours are so many times farther than usual are outliers
SELECTED = 300  # points that select among hypotheses
CLOSE = 0.05  # hypotheses whose costs differ less are both refined
SAME = 0.002  # hypotheses of one kind whose costs differ less are one shape that was found twice
LEVEL = 1e-3  # of the unit axis of a shape, a component that counts as none
PRICE = 0.004  # of each bound of a shape, as a share of the points


@dataclass(frozen=True, eq=False)
class Primitive:
    """A shape in the frame of the points that it was fitted to."""

    kind: str  # A key of `SHAPES`
    size: tuple[float, ...]  # the parameters that `SHAPES` names, metres
    # (4, 4) the frame of the shape. The origin is at the centre (of a cone: at the centre of its
    # base); z is the axis of a cylinder, and points to the tip of a cone
    pose: Floats
    inliers: float  # share of the points within the tolerance of the surface
    # standard deviation of each size, metres; infinite where the points do not show it. The size is
    # then the least one
    deviation: tuple[float, ...]
    tolerance: float  # distance of inliers, metres

    def distance(self, points: ArrayLike) -> Floats:
        """Return the distances of points (n, 3) to the surface, metres."""
        bounds = _bounds_of(self.kind, self.size)
        placed = Placed(self.kind, self.pose[:3, :3], self.pose[:3, 3], bounds)
        return np.abs(placed.distances(np.asarray(points, float)))


def fit_primitive(
    points: ArrayLike,
    normals: ArrayLike | None = None,
    *,
    table: Plane | None = None,
    kinds: Collection[str] = tuple(SHAPES),
    tolerance: float | None = None,
    seed: int = 0,
) -> Primitive:
    """Return the shape that fits a cluster of points best.

    Parameters
    ----------
    points : (n, 3) metres; NaN rows are left out
    normals : (n, 3) of the surface, of any sign; estimated from neighbours where None
    table : the plane that the object stands on: it ends what no camera sees
    kinds : the shapes to try, of `SHAPES`
    tolerance : distance of inliers, metres; by default three deviations of the noise, at least 1 %
        of the cluster's diameter

    Raises
    ------
    PerceptionError
        Fewer than 30 finite points, arrays of other shapes, an unknown kind, or points to which no
        shape fits, such as points on a line.

    Examples
    --------
    >>> import numpy as np
    >>> unit = np.random.default_rng(1).normal(size=(500, 3))
    >>> ball = 0.1 * unit / np.linalg.norm(unit, axis=1, keepdims=True)
    >>> found = fit_primitive(ball)
    >>> found.kind, round(found.size[0], 3)
    ('sphere', 0.1)
    """
    unknown = [kind for kind in kinds if kind not in SHAPES]
    if unknown or not kinds:
        raise PerceptionError(f"the kinds {unknown} are unknown: choose of {', '.join(SHAPES)}")
    if tolerance is not None and not tolerance > 0:
        raise PerceptionError(f"the tolerance is {tolerance} m: give a number above 0")
    random = np.random.default_rng(seed)
    cloud, fitted, centre = _surfels_of(points, normals, random)
    if table is not None:
        table = Plane(table.normal, table.offset - float(centre @ table.normal))
    widths = np.linalg.svd(fitted.points, compute_uv=False)
    if widths[1] <= 1e-3 * widths[0]:
        where = "on a line" if widths[0] > 0 else "at one place"
        raise PerceptionError(f"the {len(cloud)} points are {where}: give points of a surface")
    diameter = float(np.linalg.norm(np.ptp(fitted.points, axis=0)))
    noise = max(fitted.noise, 2e-4 * diameter)
    within = tolerance if tolerance is not None else max(3 * noise, 0.01 * diameter)
    up = None if table is None else table.normal
    rough = hypotheses(fitted, max(within, 4 * noise), up, random)
    few = fitted.take(SELECTED)
    fits = [
        refined(shape, few, few.points, noise, table, 1) for shape in rough if shape.kind in kinds
    ]
    usable = [fit for fit in fits if fit is not None and _is_plausible(fit, few, diameter)]
    ranked = sorted(((_cost(fit, few, within), fit.placed) for fit in usable), key=itemgetter(0))
    finalists = _finalists(ranked)
    fits = [refined(shape, fitted, cloud, noise, table) for shape in finalists]
    usable = [fit for fit in fits if fit is not None and _is_plausible(fit, fitted, diameter)]
    if not usable:
        raise PerceptionError(
            f"no {' or '.join(kinds)} fits the {len(cloud)} points: give points of a surface"
        )
    best = min(usable, key=lambda fit: _cost(fit, fitted, within))
    return primitive_of(best, cloud, centre, within)


def _surfels_of(
    points: ArrayLike, normals: ArrayLike | None, random: np.random.Generator
) -> tuple[Floats, Surfels, Floats]:
    """All finite points about their mean; those that are fitted, with normals; and the mean."""
    if normals is None:
        cloud = checked_points(points, FEWEST, "the cluster")
        centre = cloud.mean(axis=0)
        cloud = cloud - centre
        return cloud, surfels(cloud[random.permutation(len(cloud))[:FITTED]], alone=ALONE), centre
    given, across = np.asarray(points, float), np.asarray(normals, float)
    if given.shape != across.shape:
        raise PerceptionError(
            f"there are {across.shape} normals for {given.shape} points: give one for each point"
        )
    checked_points(given, FEWEST, "the cluster")
    both = np.concatenate([given.reshape(-1, 3), across.reshape(-1, 3)], axis=1)
    both = both[np.isfinite(both).all(axis=1)]
    checked_points(both[:, :3], FEWEST, "the cluster with its normals")
    centre = both[:, :3].mean(axis=0)
    both[:, :3] -= centre
    chosen = both[random.permutation(len(both))[:FITTED]]
    flat = surfels(chosen[:, :3])
    length = np.maximum(np.linalg.norm(chosen[:, 3:], axis=1, keepdims=True), 1e-12)
    fitted = Surfels(flat.points, chosen[:, 3:] / length, 0.0, flat.spacing)
    return both[:, :3], fitted, centre


def _finalists(ranked: list[tuple[float, Placed]]) -> list[Placed]:
    """The shape of least cost, and the next close one, unless it is the first one again."""
    if not ranked:
        return []
    least, best = ranked[0]
    others = [
        shape
        for cost, shape in ranked[1:]
        if cost < least + CLOSE and (shape.kind != best.kind or cost > least + SAME)
    ]
    return [best, *others[:1]]


def _is_plausible(fit: Fit, cloud: Surfels, diameter: float) -> bool:
    """Whether a shape is of the size of its points, and a cone has points near its tip."""
    kind, bounds = fit.placed.kind, fit.placed.bounds
    size = size_of(kind, bounds)
    if not (size > 0).all() or size.max() > 2 * diameter or size[0] > diameter:
        return False
    if kind != "cone":
        return True
    z = fit.local(cloud.points)[:, 2]
    top = float(np.quantile(z[z <= bounds[2]], 0.98)) if (z <= bounds[2]).any() else -np.inf
    near_tip = bounds[2] - top < 0.3 * size[1]
    return bool(fit.seen[0] and near_tip and SLIMMEST < bounds[0] < WIDEST)


def _cost(fit: Fit, cloud: Surfels, within: float) -> float:
    """How badly a shape explains the points: distances and normals; complex shapes pay a little."""
    cost = semmap_native.shape_cost(*fit.placed, cloud.points, cloud.normals, within)
    return cost + PRICE * len(fit.placed.bounds)


def primitive_of(fit: Fit, points: Floats, mean: Floats, within: float) -> Primitive:
    """Return a fit to points about their mean, with its origin in the middle and ordered axes.

    Points within so many metres are inliers.
    """
    kind, rotation, origin, bounds = fit.placed
    size, deviation = size_of(kind, bounds), fit.deviation
    distance = np.abs(fit.placed.distances(points))
    middle = np.zeros(3)
    if kind == "cuboid":
        middle = (bounds[:3] + bounds[3:]) / 2
    elif kind == "cylinder":
        middle[2] = (bounds[1] + bounds[2]) / 2
    elif kind == "cone":
        middle[2] = bounds[1]
    centre = mean + origin + rotation @ middle
    if kind == "sphere":
        rotation = np.eye(3)
    elif kind in ("cylinder", "cone"):
        rotation = _about_axis(rotation[:, 2], either_way=kind == "cylinder")
    elif kind == "cuboid":
        z = int(np.abs(rotation[2]).argmax())
        x = max((z + 1) % 3, (z + 2) % 3, key=lambda i: abs(rotation[0, i]))
        order = [x, 3 - x - z, z]
        rotation, size, deviation = rotation[:, order], size[order], deviation[order]
        rotation = rotation * np.where(np.diag(rotation) < 0, -1, 1)
        rotation[:, 1] *= np.sign(np.linalg.det(rotation))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, centre
    return Primitive(
        kind,
        tuple(map(float, size)),
        pose,
        float((distance <= within).mean()),
        tuple(map(float, deviation)),
        within,
    )


def _bounds_of(kind: str, size: tuple[float, ...]) -> Floats:
    """The bounds of a shape in the frame of a `Primitive`."""
    if kind == "cuboid":
        return np.concatenate([np.negative(size), size]) / 2
    if kind == "cylinder":
        return np.array([size[0], -size[1] / 2, size[1] / 2])
    if kind == "cone":
        return np.array([size[0] / size[1], 0.0, size[1]])
    return np.array(size)


def _about_axis(axis: Floats, *, either_way: bool) -> Floats:
    """The rotation (3, 3) of a round shape about its axis; x is nearest to the outer x axis.

    An axis without a direction points up; if it is level, along x or y.
    """
    if either_way:
        first = next(i for i in (2, 0, 1) if abs(axis[i]) > LEVEL)
        axis = axis * np.sign(axis[first])
    x = np.eye(3)[0 if abs(axis[0]) < 0.9 else 1]
    x = x - axis * (x @ axis)
    x /= np.linalg.norm(x)
    found: Floats = np.stack([x, np.cross(axis, x), axis], axis=1)
    return found
