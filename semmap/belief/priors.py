"""Where objects are before any sighting: from their types, and from where they were before."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.belief.error import BeliefError

__all__ = ["make_prior"]


def make_prior(
    fits: ArrayLike,
    typical: ArrayLike | None = None,
    counts: ArrayLike | None = None,
    elsewhere: float = 0.05,
    strength: float = 4.0,
) -> NDArray[np.float64]:
    """Return prior probabilities of n objects at m places and *elsewhere*.

    An object is elsewhere with the given probability; else its place has a Dirichlet prior with
    mean `typical` and weight `strength`, which the counts of earlier stays update.

    Parameters
    ----------
    fits
        (n, m) bool; False where the object does not fit.
    typical
        (n, m) at least 0: how common a place is for objects of this type, relative to the other
        places (cereals are mostly in kitchens). Equal by default.
    counts
        (n, m) at least 0: how often, or in what share of its history, the object was there.
    elsewhere
        Probability that the object is at none of the places, in [0, 1).
    strength
        The number of stays that `typical` is worth, above 0.

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
    >>> make_prior([[True, True, False]], counts=[[4, 0, 0]], elsewhere=0.2).round(3)
    array([[0.6, 0.2, 0. , 0.2]])
    """
    possible = np.asarray(fits, np.bool_)
    if possible.ndim != 2:
        raise BeliefError(f"fits has shape {possible.shape}: give (objects, places)")
    if not 0 <= elsewhere < 1:
        raise BeliefError(f"elsewhere is {elsewhere}: give a probability in [0, 1)")
    if not (np.isfinite(strength) and strength > 0):
        raise BeliefError(f"strength is {strength}: give a number above 0")
    common = _weights("typical", 1.0 if typical is None else typical, possible)
    stays = _weights("counts", 0.0 if counts is None else counts, possible)
    contradicting = (stays > 0) & ~possible
    if contradicting.any():
        o, p = np.argwhere(contradicting)[0]
        raise BeliefError(
            f"counts say that object {o} was at place {p}, where it does not fit: correct its size "
            "or the history"
        )
    common = np.where(possible, common, 0.0)
    unknown = common.sum(axis=1) == 0
    common[unknown] = possible[unknown]
    total = common.sum(axis=1, keepdims=True)
    mean = np.divide(common, total, out=np.zeros_like(common), where=total > 0)
    place = (strength * mean + stays) / (strength + stays.sum(axis=1, keepdims=True))
    found = np.column_stack([(1 - elsewhere) * place, np.full(len(place), elsewhere)])
    found[total[:, 0] == 0, -1] = 1.0
    return np.asarray(found / found.sum(axis=1, keepdims=True))


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
