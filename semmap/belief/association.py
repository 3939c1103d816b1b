"""Moved or new: which known instance each detection is of, if any.

A hypothesis assigns each detection to a known instance or to a new one, and no instance to two
detections. Its weight is the product of the likelihoods; Murty's method finds the best ones.
"""

from __future__ import annotations

import heapq
import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from semmap.belief.error import BeliefError

NEW = -1
"""Stands for a new instance in an assignment."""

LOG_SIZE_RANGE = math.log(1000.0)
"""Sizes of which nothing is known are log-uniform over three decades, such as 1 cm to 10 m."""

ALIKE, CLASS_SPREAD = 0.9, 0.3
"""This share of new instances are as large as the known ones of their class, with this standard
deviation of the logarithm; sizes of the others are log-uniform."""


@dataclass(frozen=True)
class Association:
    """The best hypotheses, best first.

    `instance` (hypotheses, detections) has the index of each detection's instance, or `NEW`;
    `probability` (hypotheses,) sums to 1 over the hypotheses kept.
    """

    instance: NDArray[np.intp]
    probability: NDArray[np.float64]

    def marginals(self, instances: int) -> NDArray[np.float64]:
        """P(detection is of instance), (detections, instances + 1); the last column is *new*."""
        hypotheses, detections = self.instance.shape
        found = np.zeros((detections, instances + 1))
        rows = np.broadcast_to(np.arange(detections), self.instance.shape)
        weight = np.broadcast_to(self.probability[:, None], (hypotheses, detections))
        np.add.at(found, (rows, self.instance), weight)
        return found


class Likelihoods(NamedTuple):
    """What a view says of k detections and n instances, as `associate` takes it."""

    same: NDArray[np.float64]
    new: NDArray[np.float64]
    missed: NDArray[np.float64]


def view_likelihoods(
    belief: ArrayLike,
    view: ArrayLike,
    place: ArrayLike,
    same_class: ArrayLike,
    size: ArrayLike | None = None,
    known_size: ArrayLike | None = None,
    hit: float = 0.7,
    new: ArrayLike = 0.05,
    spread: float = 0.1,
) -> Likelihoods:
    """Return the likelihoods of k detections in one view, by class, size, place and time.

    One cup is known, which was on the table; now a cup is seen on the shelf:

    >>> cup = view_likelihoods([[0.8, 0.2]], view=[0, 1], place=[1], same_class=[[0.9]])
    >>> associate(*cup).marginals(1).round(3)
    array([[0.807, 0.193]])

    Parameters
    ----------
    belief : (n, m) where the n known instances are now, by `semmap.belief.motion.infer_with_motion`
    view : (m,) the share of each place that the view showed, in [0, 1]
    place : (k,) the place of each detection, as a column of the belief
    same_class : (k, n) P(detected as this class | class of the instance)
    size, known_size : (k,) and (n,) a length of detections and instances, above 0; NaN: unknown.
        Most new instances are about as large as the known ones of their class
    hit : P(detected | in view), strictly between 0 and 1
    new : (k,) the expected number of instances that the map lacks, at this place and of this class
    spread : standard deviation of the measured size, relative to the size

    Raises
    ------
    BeliefError
        Arrays that do not fit, numbers out of range, or a detection outside of the view.
    """
    where, shares = np.asarray(belief, np.float64), np.asarray(view, np.float64)
    at, classes = np.asarray(place), np.asarray(same_class, np.float64)
    if where.ndim != 2 or shares.shape != where.shape[1:]:
        raise BeliefError(f"view has shape {shares.shape}: give a share for each place")
    if at.ndim != 1 or (len(at) and not np.issubdtype(at.dtype, np.integer)):
        raise BeliefError("place: give a column of the belief for each detection")
    at = at.astype(np.intp)
    if len(at) and not (at.min() >= 0 and at.max() < len(shares)):
        raise BeliefError(f"place is {at.tolist()}: the belief has places 0 to {len(shares) - 1}")
    if not ((shares >= 0) & (shares <= 1)).all():
        raise BeliefError(f"view is {shares.tolist()}: give shares in [0, 1]")
    if not 0 < hit < 1:
        raise BeliefError(f"hit is {hit}: give a probability strictly between 0 and 1")
    if classes.shape != (len(at), len(where)):
        raise BeliefError(f"same_class has shape {classes.shape}: give {(len(at), len(where))}")
    unseen = shares[at] == 0
    if unseen.any():
        j = int(np.argmax(unseen))
        raise BeliefError(f"detection {j} is at place {at[j]}, which is not in the view")
    same = hit * shares[at, None] * where[:, at].T * classes
    fresh = hit * shares[at] * np.asarray(new, np.float64)
    if size is not None and known_size is not None:
        same *= _size_density(size, known_size, spread, same.shape)
        wider = _size_density(size, known_size, math.hypot(spread, CLASS_SPREAD), same.shape)
        count = classes.sum(axis=1)
        alike = np.divide(
            (wider * classes).sum(axis=1),
            count,
            where=count > 0,
            out=np.full(len(at), 1 / LOG_SIZE_RANGE),
        )
        fresh *= ALIKE * alike + (1 - ALIKE) / LOG_SIZE_RANGE
    return Likelihoods(same, fresh, 1 - hit * (where @ shares))


def associate(same: ArrayLike, new: ArrayLike, missed: ArrayLike, keep: int = 10) -> Association:
    """Return the `keep` hypotheses of largest weight.

    `same` (k, n) is the likelihood of each detection if it is of each instance, at least 0; `new`
    (k,) if it is of a new one, above 0. `missed` (n,) is P(an instance has no detection), in (0,
    1]. `BeliefError` if arrays do not fit or numbers are out of range.
    """
    likelihood, fresh = np.asarray(same, np.float64), np.asarray(new, np.float64)
    undetected = np.asarray(missed, np.float64)
    k, n = len(fresh), len(undetected)
    if likelihood.shape != (k, n):
        raise BeliefError(f"same has shape {likelihood.shape}: give {(k, n)}, as of new and missed")
    if not (np.isfinite(likelihood) & (likelihood >= 0)).all():
        raise BeliefError("same has a likelihood that is not a number of at least 0")
    if not (np.isfinite(fresh) & (fresh > 0)).all():
        raise BeliefError(f"new is {fresh.tolist()}: give likelihoods above 0")
    if not ((undetected > 0) & (undetected <= 1)).all():
        raise BeliefError(f"missed is {undetected.tolist()}: give probabilities in (0, 1]")
    if keep < 1:
        raise BeliefError(f"keep is {keep}: give at least 1")
    cost = np.full((k, n + k), np.inf)
    with np.errstate(divide="ignore"):
        cost[:, :n] = np.log(undetected) - np.log(likelihood)
    cost[np.arange(k), n + np.arange(k)] = -np.log(fresh)
    found = _best_assignments(cost, keep)
    weight = np.exp(found[0][0] - np.array([total for total, _ in found]))
    columns = np.array([assigned for _, assigned in found], np.intp).reshape(len(found), k)
    return Association(np.where(columns < n, columns, NEW), weight / weight.sum())


def _best_assignments(cost: NDArray[np.float64], keep: int) -> list[tuple[float, NDArray[np.intp]]]:
    """The assignments of rows to columns of least cost, by Murty's method: total and columns.

    A candidate is the best of those that agree on the first rows; they are then split by the first
    row that differs from it.
    """
    count = itertools.count()
    best = _best_assignment(cost)
    candidates = [] if best is None else [(best[0], next(count), best[1], 0, cost)]
    found: list[tuple[float, NDArray[np.intp]]] = []
    while candidates and len(found) < keep:
        total, _, columns, fixed, allowed = heapq.heappop(candidates)
        found.append((total, columns))
        agreeing = allowed.copy()
        for row in range(fixed, len(columns)):
            others = agreeing.copy()
            others[row, columns[row]] = np.inf
            best = _best_assignment(others)
            if best is not None:
                heapq.heappush(candidates, (best[0], next(count), best[1], row, others))
            own = agreeing[row, columns[row]]
            agreeing[row] = np.inf
            agreeing[row, columns[row]] = own
    return found


def _best_assignment(cost: NDArray[np.float64]) -> tuple[float, NDArray[np.intp]] | None:
    try:
        rows, columns = linear_sum_assignment(cost)
    except ValueError:  # no assignment of finite cost
        return None
    return float(cost[rows, columns].sum()), columns


def _size_density(
    size: ArrayLike, known: ArrayLike, spread: float, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """(k, n) density of the logarithm of the measured sizes for the known ones."""
    measured, true = np.asarray(size, np.float64), np.asarray(known, np.float64)
    if (len(measured), len(true)) != shape:
        raise BeliefError(f"sizes: {len(measured)} and {len(true)} are given: give {shape}")
    if (measured <= 0).any() or (true <= 0).any():
        raise BeliefError("sizes: give lengths above 0, or NaN")
    if not spread > 0:
        raise BeliefError(f"spread is {spread}: give a number above 0")
    away = (np.log(measured)[:, None] - np.log(true)) / spread
    density = np.exp(-0.5 * away**2) / (spread * math.sqrt(2 * math.pi))
    return np.where(np.isnan(density), 1 / LOG_SIZE_RANGE, density)
