"""How likely a detection is at its position within a place, if it is of a known instance."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.belief.error import BeliefError

STAYS = 0.9
"""Of instances that have not left a place, this share was not moved within it."""


def position_likelihood(
    point: ArrayLike,
    known: ArrayLike,
    area: ArrayLike,
    stayed: ArrayLike,
    spread: float = 0.1,
) -> NDArray[np.float64]:
    """Return (k, n) densities of detections over that of a uniform position in their place.

    An instance that stayed is about where it was, with normal errors across; one that came or was
    moved is anywhere in the place. Above or below its height, the error falls likewise.

    Parameters
    ----------
    point : (k, 3) the detections, metres
    known : (k, n, 4) x, y, lowest and highest z of each instance; NaN if not known to be at the
        place of the detection
    area : (k,) of the surfaces of each place, square metres; NaN: unknown
    stayed : (k, n) P(the instance has not left the place, given that it is there)
    spread : standard deviation of the position, metres

    Examples
    --------
    Two mugs on a table of 1 m2, at 0.1 m and at 0.5 m from a known one:

    >>> known = [[[0, 0, 1, 1.1]]] * 2
    >>> position_likelihood([[0.1, 0, 1], [0.5, 0, 1]], known, [1, 1], [[1]] * 2).round(1)
    array([[8.8],
           [0.1]])
    """
    if not spread > 0:
        raise BeliefError(f"spread is {spread}: give a number above 0")
    at, was = np.asarray(point, np.float64), np.asarray(known, np.float64)
    room = np.asarray(area, np.float64)[:, None]
    across = (at[:, None, :2] - was[..., :2]) / spread
    height = at[:, None, 2]
    outside = np.maximum(np.maximum(was[..., 2] - height, height - was[..., 3]), 0) / spread
    away = (across**2).sum(axis=2) + outside**2
    peak = np.maximum(room / (2 * np.pi * spread**2), 1.0)
    share = STAYS * np.asarray(stayed, np.float64)
    ratio = share * peak * np.exp(-0.5 * away) + 1 - share
    return np.where(np.isnan(ratio), 1.0, ratio)
