"""The exact belief where a larger object may hide a smaller one at the same place.

Hiding couples the places of objects. The joint distribution is summed over sets of places that
larger objects occupy, from the largest object to the smallest. Only places where a smaller object
was looked for count, so the states are few; all else has its closed form.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from semmap.belief.error import BeliefError
from semmap.belief.inference import (
    checked_column,
    checked_prior,
    log_ratios,
    log_weights,
    normalised,
)
from semmap.belief.observation_columns import Observations, observation_rates
from semmap.belief.sighting_model import THESIS, SightingRates
from semmap.geometry.voxel_keys import sorted_unique

CHOICES = 2**22
"""The largest number of choices, over all sets of occupied places; more would take seconds."""

BITS = 31
"""Places in a set: two sets are one int64 key."""


def infer_with_occlusion(
    prior: ArrayLike,
    observations: Observations,
    mobility: ArrayLike,
    volume: ArrayLike,
    hides: float = 0.5,
    hidden: float = 0.3,
    model: SightingRates = THESIS,
) -> NDArray[np.float64]:
    """Return the probability of each place for each object, where larger objects may hide smaller.

    An object that shares its place with objects of more volume is behind them with probability
    `hides`, in all looks; then each look sees it with probability `hidden`. Two objects of the same
    volume do not hide each other. Returns (objects, places) float64; rows sum to 1 within 1e-12.

    Parameters
    ----------
    prior, observations, mobility, model : as of `semmap.belief.inference.infer`
    volume : (objects,) above 0, in any unit
    hides : P(behind | larger objects at the same place), in [0, 1]
    hidden : P(seen | behind), strictly between 0 and 1

    Raises
    ------
    BeliefError
        The arrays do not fit, or too many objects and places depend on each other.

    Examples
    --------
    A coke is not seen beside a cereal box, which may hide it:

    >>> looks = Observations([0, 1], [0, 0], [0.0, 0.0], [False, True])
    >>> infer_with_occlusion([[0.5, 0.5]] * 2, looks, [1.0, 1.0], [6.6, 16.6]).round(3)
    array([[0.363, 0.637],
           [0.805, 0.195]])
    """
    prior = checked_prior(prior, observations)
    mobility = checked_column("mobility", mobility, len(prior))
    volume = checked_column("volume", volume, len(prior), above_zero=True)
    check_hiding(hides, hidden)
    there, elsewhere = observation_rates(observations, mobility, model)
    alone = log_weights(prior, observations, log_ratios(observations, there, elsewhere))
    behind = log_weights(
        prior, observations, log_ratios(observations, np.full_like(there, hidden), elsewhere)
    )
    with np.errstate(divide="ignore"):
        beside = np.logaddexp(np.log(hides) + behind, np.log1p(-hides) + alone)
    looked = np.zeros(prior.shape, np.bool_)
    looked[observations.object, observations.place] = True
    largest = np.where(prior > 0, volume[:, None], 0).max(axis=0, initial=0)
    may_be_hidden = (prior > 0) & looked & (largest > volume[:, None])
    weights = _Weights(alone, beside, may_be_hidden)
    posterior = alone.copy()
    for objects, places in _groups(weights, volume):
        rows = objects[np.argsort(-volume[objects], kind="stable")]
        posterior[rows] = _sum_over_sets(rows, places, weights, volume)
    return normalised(posterior)


class _Weights(NamedTuple):
    """(objects, places) log weights of objects alone and of those beside larger ones.

    They differ only where an object may be hidden and was looked for.
    """

    alone: NDArray[np.float64]
    beside: NDArray[np.float64]
    may_be_hidden: NDArray[np.bool_]


def _groups(
    weights: _Weights, volume: NDArray[np.float64]
) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Objects and places of each group whose members depend on each other.

    Two objects are joined by a place where one may hide the other and the other was looked for.
    """
    hidden, possible = weights.may_be_hidden, weights.alone > -np.inf
    least = np.where(hidden, volume[:, None], np.inf).min(axis=0, initial=np.inf)
    o, p = np.nonzero(hidden | (possible & (volume[:, None] > least)))
    edges = coo_array((np.ones(len(o)), (o, len(volume) + p)), (sum(possible.shape),) * 2)
    label = connected_components(edges, directed=False)[1][o]
    return [(sorted_unique(o[label == k]), sorted_unique(p[label == k])) for k in np.unique(label)]


class _Step(NamedTuple):
    """The sets of occupied places that follow from the place of one object.

    `forward` (states,) is the log weight of each set that larger objects occupy. `places` (c,)
    concern others; `rest` masks those that are one choice together. `weight` (states, choices) is
    the log weight of each choice, the last of the rest; `target` is the set afterwards, as an
    index.
    """

    forward: NDArray[np.float64]
    places: NDArray[np.intp]
    rest: NDArray[np.bool_]
    weight: NDArray[np.float64]
    target: NDArray[np.intp]


def _steps(
    rows: NDArray[np.intp],
    places: NDArray[np.intp],
    weights: _Weights,
    volume: NDArray[np.float64],
) -> list[_Step]:
    """The steps of objects that are ordered by falling volume.

    A key is a set of places. Its lower half has those that larger objects occupy, its upper half
    those of objects that are as large as the present one, until a smaller one follows.
    """
    if len(places) > BITS:
        raise _too_many(len(rows), len(places))
    bit = np.zeros(weights.alone.shape[1], np.int64)
    bit[places] = 1 << np.arange(len(places), dtype=np.int64)
    checks = (weights.may_be_hidden[rows] * bit).sum(axis=1)
    later = np.append(np.bitwise_or.accumulate(checks[:0:-1])[::-1], 0)
    last_of_size = np.searchsorted(-volume[rows], -volume[rows], side="right") - 1
    key, forward = np.zeros(1, np.int64), np.zeros(1)
    choices = 0
    steps = []
    for i, o in enumerate(rows):
        hides = later[last_of_size[i]]
        possible = weights.alone[o] > -np.inf
        own = np.flatnonzero(possible & ((bit & (checks[i] | hides)) != 0))
        rest = possible.copy()
        rest[own] = False
        choices += len(key) * (len(own) + int(rest.any()))
        if choices > CHOICES:
            raise _too_many(len(rows), len(places))
        occupied = (key[:, None] & bit[own]) != 0
        weight = np.where(occupied, weights.beside[o, own], weights.alone[o, own])
        added = (bit[own] & hides) << 32
        if rest.any():
            together = np.logaddexp.reduce(weights.alone[o, rest])
            weight = np.column_stack([weight, np.full(len(key), together)])
            added = np.append(added, 0)
        reached = key[:, None] | added
        if i == last_of_size[i]:
            reached = (reached | (reached >> 32)) & later[i]
        key, target = np.unique(reached, return_inverse=True)
        target = target.reshape(reached.shape)
        steps.append(_Step(forward, own, rest, weight, target))
        forward = _log_sums(forward[:, None] + weight, target, len(key))
    return steps


def _sum_over_sets(
    rows: NDArray[np.intp],
    places: NDArray[np.intp],
    weights: _Weights,
    volume: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The log weights of the given rows, which are ordered by falling volume."""
    found = weights.alone[rows]
    steps = _steps(rows, places, weights, volume)
    backward = np.zeros(1)
    for i in range(len(rows) - 1, -1, -1):
        step = steps[i]
        onward = step.weight + backward[step.target]
        total = np.logaddexp.reduce(step.forward[:, None] + onward, axis=0)
        found[i, step.places] = total[: len(step.places)]
        if step.rest.any():
            found[i, step.rest] += total[-1] - step.weight[0, -1]
        backward = np.logaddexp.reduce(onward, axis=1)
    return found


def _log_sums(
    value: NDArray[np.float64], group: NDArray[np.intp], groups: int
) -> NDArray[np.float64]:
    """log Σ exp(value) over the entries of each group."""
    peak = np.full(groups, -np.inf)
    np.maximum.at(peak, group.ravel(), value.ravel())
    return peak + np.log(np.bincount(group.ravel(), np.exp(value - peak[group]).ravel()))


def _too_many(objects: int, places: int) -> BeliefError:
    return BeliefError(
        f"occlusion: {objects} objects may hide each other at {places} places, which is too much "
        "to sum exactly: rule out places in the priors, leave out old observations, or infer "
        "without occlusion"
    )


def check_hiding(hides: float, hidden: float) -> None:
    """Raise `BeliefError` unless these are probabilities, the second strictly between 0 and 1."""
    if not 0 <= hides <= 1:
        raise BeliefError(f"hides is {hides}: give a probability")
    if not 0 < hidden < 1:
        raise BeliefError(f"hidden is {hidden}: give a probability strictly between 0 and 1")
