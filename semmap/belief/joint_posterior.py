"""The posterior of all hypotheses together: which instance each detection is of.

A hypothesis assigns each detection to a known instance or to a new one, and no instance to two
detections. The sum over all of them is computed over sets of detections, instance by instance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from semmap.belief.association import associate

FEW = 12
"""Detections that may be of the same instances, up to which all hypotheses are summed."""

MANY = 100
"""Hypotheses that are summed for more detections: the best ones."""


def joint_marginals(same: ArrayLike, new: ArrayLike, missed: ArrayLike) -> NDArray[np.float64]:
    """P(detection is of instance), (k, n + 1), by all hypotheses; the last column is *new*.

    Arguments and errors are those of `association.associate`. It is exact if at most `FEW`
    detections may be of the same instances, else of the `MANY` best hypotheses.

    Examples
    --------
    Three mugs are seen where one is known; the second detection is the nearest to it:

    >>> joint_marginals([[0.1], [0.8], [0.1]], [0.01] * 3, [0.3]).round(2)
    array([[0.1, 0.9],
           [0.8, 0.2],
           [0.1, 0.9]])
    """
    associate(same, new, missed, 1)  # refuses what is wrong
    likelihood = np.asarray(same, np.float64)
    fresh, undetected = np.asarray(new, np.float64), np.asarray(missed, np.float64)
    found = np.zeros((len(fresh), len(undetected) + 1))
    for rows in _groups(likelihood):
        columns = np.flatnonzero(likelihood[rows].any(axis=0))
        part = likelihood[np.ix_(rows, columns)]
        if len(rows) > FEW:
            known = associate(part, fresh[rows], undetected[columns], MANY).marginals(len(columns))
            known = known[:, :-1]
        else:
            known = _sum_of_all(part / undetected[columns], fresh[rows])
        found[np.ix_(rows, columns)] = known
    found[:, -1] = np.clip(1 - found[:, :-1].sum(axis=1), 0, 1)
    return found


def one_each(share: ArrayLike, least: float) -> list[int | None]:
    """The instance of each detection, none twice, so that the most are right as expected.

    `share` (k, n) is P(detection is of instance); one below `least` is not taken: None.
    """
    shares = np.asarray(share, np.float64)
    rows, columns = linear_sum_assignment(np.where(shares >= least, shares, 0.0), maximize=True)
    chosen: list[int | None] = [None] * len(shares)
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        if shares[row, column] >= least:
            chosen[row] = column
    return chosen


def _groups(likelihood: NDArray[np.float64]) -> list[NDArray[np.intp]]:
    """The detections that may be of the same instances, directly or by others between them."""
    possible = csr_array((likelihood > 0).astype(float))
    count, of = connected_components(possible @ possible.T, directed=False)
    return [np.flatnonzero(of == group) for group in range(count)]


def _sum_of_all(odds: NDArray[np.float64], new: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, n) marginals: each hypothesis weighs as the product of `odds` (k, n) and of `new` (k,).

    `before[i][s]` is the weight of all ways to give the detections of the set s to the first i
    instances, `after[i][s]` of all ways to go on from there.
    """
    scale = np.maximum(odds.max(axis=1, initial=0.0), new)[:, None]
    weight, fresh = odds / scale, new / scale[:, 0]
    k, n = weight.shape
    sets = np.arange(2**k)
    has = (sets[:, None] >> np.arange(k) & 1).astype(bool)
    before = np.zeros((n + 1, 2**k))
    after = np.zeros((n + 1, 2**k))
    before[0, 0] = 1.0
    after[n] = np.where(has, 1.0, fresh).prod(axis=1)
    for i in range(n):
        before[i + 1] = before[i]
        for j in range(k):
            before[i + 1, has[:, j]] += weight[j, i] * before[i, ~has[:, j]]
    for i in reversed(range(n)):
        after[i] = after[i + 1]
        for j in range(k):
            after[i, ~has[:, j]] += weight[j, i] * after[i + 1, has[:, j]]
    shares = np.empty((k, n))
    for j in range(k):
        ways = np.einsum("is,is->i", before[:-1, ~has[:, j]], after[1:, has[:, j]])
        shares[j] = weight[j] * ways / after[0, 0]
    return shares
