"""Where objects are before any sighting: from their types, and from where they were before."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.belief.error import BeliefError


def make_prior(
    fits: ArrayLike,
    typical: ArrayLike | None = None,
    stays: ArrayLike | None = None,
    elsewhere: float = 0.1,
    history: float = 0.5,
) -> NDArray[np.float64]:
    """Return prior probabilities of n objects at m places and *elsewhere*, as those of the map.

    An object is elsewhere with the given probability. Else it is at a place of its history with
    probability `history`, and at any place where it fits otherwise.

    Parameters
    ----------
    fits
        (n, m) bool; False where the object does not fit.
    typical
        (n, m) at least 0: how common a place is for objects of this type, relative to the other
        places (cereals are mostly in kitchens). Equal by default.
    stays
        (n, m) at least 0: how much each place counts in the history of the object. An object whose
        stays are all 0 has no history.
    elsewhere, history
        Probabilities in [0, 1).

    Returns
    -------
    numpy.ndarray
        (n, m + 1) float64; rows sum to 1. The last column is *elsewhere*, which is 1 for an object
        that fits nowhere.

    Raises
    ------
    BeliefError
        Numbers out of range, arrays of different shapes, or an earlier stay where the object does
        not fit.

    Examples
    --------
    >>> make_prior([[True, True, False]], stays=[[4, 0, 0]], elsewhere=0.2).round(3)
    array([[0.6, 0.2, 0. , 0.2]])
    """
    possible = np.asarray(fits, np.bool_)
    if possible.ndim != 2:
        raise BeliefError(f"fits has shape {possible.shape}: give (objects, places)")
    for name, value in (("elsewhere", elsewhere), ("history", history)):
        if not 0 <= value < 1:
            raise BeliefError(f"{name} is {value}: give a probability in [0, 1)")
    common = _weights("typical", 1.0 if typical is None else typical, possible)
    former = _weights("stays", 0.0 if stays is None else stays, possible)
    contradicting = (former > 0) & ~possible
    if contradicting.any():
        o, p = np.argwhere(contradicting)[0]
        raise BeliefError(
            f"stays say that object {o} was at place {p}, where it does not fit: correct its size "
            "or the history"
        )
    common = np.where(possible, common, 0.0)
    unknown = common.sum(axis=1) == 0
    common[unknown] = possible[unknown]
    place, former = _shares(common), _shares(former)
    with_history = former.any(axis=1)
    place[with_history] *= 1 - history
    place += history * former
    found = np.column_stack([(1 - elsewhere) * place, np.full(len(place), elsewhere)])
    found[~possible.any(axis=1), -1] = 1.0
    return np.asarray(found / found.sum(axis=1, keepdims=True))


def _shares(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """The weights of each row over their sum; zeros stay."""
    total = weights.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(weights, total, out=np.zeros_like(weights), where=total > 0))


def _weights(name: str, values: ArrayLike, possible: NDArray[np.bool_]) -> NDArray[np.float64]:
    found = np.asarray(values, np.float64)
    if found.ndim and found.shape != possible.shape:
        raise BeliefError(f"{name} has shape {found.shape}: give {possible.shape}, as of fits")
    found = np.broadcast_to(found, possible.shape)
    wrong = ~(np.isfinite(found) & (found >= 0))
    if wrong.any():
        o, p = np.argwhere(wrong)[0]
        raise BeliefError(f"{name} of object {o} at place {p} is {found[o, p]:g}: give at least 0")
    return found
