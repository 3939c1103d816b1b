"""The exact belief over places, of all objects at once.

With prior π(p), a = P(seen | there) and b = P(seen | not there), the posterior weight of a place is

    log w(p) = log π(p) + Σ at p log(a / b)

up to a constant; 1 - a and 1 - b replace a and b for an observation in vain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.belief.error import BeliefError
from semmap.belief.observation_columns import Observations, observation_rates
from semmap.belief.sighting_model import THESIS, SightingRates


def infer(
    prior: ArrayLike,
    observations: Observations,
    mobility: ArrayLike,
    model: SightingRates = THESIS,
) -> NDArray[np.float64]:
    """Return the probability of each place for each object.

    The result of some observations is a prior for the others: the order does not matter. Returns
    (objects, places) float64; rows sum to 1 within 1e-12.

    Parameters
    ----------
    prior : (objects, places); rows sum to 1. A place that no observation reaches, such as
        *elsewhere*, is a column like the others
    observations : ages are relative to the time of the belief
    mobility : (objects,) at least 0; sightings of an object of mobility 0 do not lose value

    Raises
    ------
    BeliefError
        The prior is not a distribution, or an observation names a row or column that it lacks.

    Examples
    --------
    >>> sightings = Observations([0, 0, 0], [1, 1, 1], [11.0, 11.0, 11.0], [True] * 3)
    >>> infer([[1 / 3, 1 / 3, 1 / 3]], sightings, [1.0]).round(3)
    array([[0.065, 0.87 , 0.065]])
    """
    prior = checked_prior(prior, observations)
    mobility = checked_column("mobility", mobility, len(prior))
    there, elsewhere = observation_rates(observations, mobility, model)
    return normalised(log_weights(prior, observations, log_ratios(observations, there, elsewhere)))


def log_ratios(
    observations: Observations, there: NDArray[np.float64], elsewhere: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return log(P(outcome | there) / P(outcome | not there)) of each observation."""
    share = 1.0 if observations.share is None else observations.share
    in_vain = (1 - share * there) / (1 - share * elsewhere)
    return np.log(np.where(observations.seen, there / elsewhere, in_vain))


def log_weights(
    prior: NDArray[np.float64], observations: Observations, ratios: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return log π(p) + Σ at p ratios for each object and place; -inf where the prior is 0."""
    objects, places = prior.shape
    cells = observations.object * places + observations.place
    evidence = np.bincount(cells, ratios, objects * places).reshape(prior.shape)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(prior) + evidence)


def normalised(log_weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return probabilities that are proportional to exp(log_weight) in each row."""
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True, initial=-np.inf))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def checked_prior(prior: ArrayLike, observations: Observations) -> NDArray[np.float64]:
    """Return the prior as an array; raise `BeliefError` where it or its observations do not fit."""
    found = np.asarray(prior, np.float64)
    if found.ndim != 2 or not found.shape[1]:
        raise BeliefError(f"prior has shape {found.shape}: give (objects, places) with a place")
    sums = found.sum(axis=1)
    if not (found.min(initial=0.0) >= 0 and np.abs(sums - 1).max(initial=0.0) <= 1e-9):
        row = int(np.argmin((found >= 0).all(axis=1) & (np.abs(sums - 1) <= 1e-9)))
        raise BeliefError(
            f"prior of object {row} sums to {sums[row]:g}, its least entry is "
            f"{found[row].min():g}: give probabilities that sum to 1"
        )
    for name, column, size in (
        ("object", observations.object, found.shape[0]),
        ("place", observations.place, found.shape[1]),
    ):
        if len(column) and not (column.min() >= 0 and column.max() < size):
            first = int(np.argmin((column >= 0) & (column < size)))
            raise BeliefError(
                f"observation {first}: {name} is {column[first]}: the prior has {name}s 0 to "
                f"{size - 1}"
            )
    return found


def checked_column(
    name: str, values: ArrayLike, objects: int, *, above_zero: bool = False
) -> NDArray[np.float64]:
    """Return a number of at least 0 for each object, or above 0; else raise `BeliefError`."""
    found = np.asarray(values, np.float64)
    if found.shape != (objects,):
        raise BeliefError(f"{name} has shape {found.shape}: give one of {objects} objects each")
    fits = np.isfinite(found) & (found > 0 if above_zero else found >= 0)
    if not fits.all():
        row = int(np.argmin(fits))
        least = "a number above 0" if above_zero else "at least 0"
        raise BeliefError(f"{name} of object {row} is {found[row]:g}: give {least}")
    return found
