"""The belief where objects may have moved between observations: a Markov chain over places.

An object of mobility M moves after exponentially distributed times, with mean seconds / M. In t
seconds, a belief p becomes k p + (1 - k) d with k = exp(-t M / seconds) and its destinations d.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.belief.error import BeliefError
from semmap.belief.inference import checked_column, checked_prior, log_ratios, normalised
from semmap.belief.observation_columns import Observations, observation_rates
from semmap.belief.sighting_model import THESIS, SightingRates


@dataclass(frozen=True)
class MotionModel:
    """How often objects move: `seconds` is the mean time between two moves at mobility 1.

    Examples
    --------
    >>> MotionModel(seconds=3600.0).after([[1.0, 0.0]], [[0.5, 0.5]], [1.0], [3600.0]).round(3)
    array([[0.684, 0.316]])
    """

    seconds: float = 86_400.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.seconds) and self.seconds > 0):
            raise BeliefError(f"motion: seconds is {self.seconds:g}: give a number above 0")

    def after(
        self,
        belief: ArrayLike,
        destinations: ArrayLike,
        mobility: ArrayLike,
        seconds: ArrayLike,
    ) -> NDArray[np.float64]:
        """Return the belief some seconds later; (objects, places), and (objects,) of at least 0."""
        with np.errstate(over="ignore"):
            moves = np.asarray(mobility, np.float64) * np.asarray(seconds, np.float64)
        keep = np.exp(-moves / self.seconds)[:, None]
        return np.asarray(keep * np.asarray(belief) + (1 - keep) * np.asarray(destinations))


DAILY = MotionModel()
"""An object of mobility 1 moves once a day."""


def infer_with_motion(
    prior: ArrayLike,
    observations: Observations,
    mobility: ArrayLike,
    motion: MotionModel = DAILY,
    destinations: ArrayLike | None = None,
    model: SightingRates = THESIS,
) -> NDArray[np.float64]:
    """Return the probability of each place now, for objects that may have moved meanwhile.

    An observation is evidence of the object's place at its time; what has happened since is the
    motion's part. So all observations have the rates of new ones. Returns (objects, places)
    float64; rows sum to 1 within 1e-12.

    Parameters
    ----------
    prior, observations, mobility, model : as of `semmap.belief.inference.infer`; the prior is that
        before the first observation
    destinations : (objects, places) where an object is put when it is moved; the prior by default

    Raises
    ------
    BeliefError
        The arrays do not fit.

    Examples
    --------
    A mug was seen on the table a week ago. Mugs move once a day:

    >>> seen = Observations([0], [0], [7 * 86_400.0], [True])
    >>> infer_with_motion([[0.25, 0.75]], seen, [1.0]).round(3)
    array([[0.25, 0.75]])
    """
    prior = checked_prior(prior, observations)
    mobility = checked_column("mobility", mobility, len(prior))
    if destinations is None:
        goals = prior
    else:
        goals = checked_prior(destinations, observations)
        if goals.shape != prior.shape:
            raise BeliefError(f"destinations have shape {goals.shape}: give that of the prior")
    new = replace(observations, age=np.zeros(len(observations)))
    there, elsewhere = observation_rates(new, mobility, model)
    ratio = log_ratios(observations, there, elsewhere)
    order = np.lexsort((-observations.age, observations.object))
    row, place = observations.object[order], observations.place[order]
    age, ratio = observations.age[order], ratio[order]
    rank = np.arange(len(row)) - np.searchsorted(row, row)
    with np.errstate(divide="ignore"):
        belief = prior.copy()
        since = np.zeros(len(prior))
        since[row[rank == 0]] = age[rank == 0]
        for k in range(int(rank.max(initial=-1)) + 1):
            now = rank == k
            o = row[now]
            before = motion.after(belief[o], goals[o], mobility[o], since[o] - age[now])
            weight = np.log(before)
            weight[np.arange(len(o)), place[now]] += ratio[now]
            belief[o] = normalised(weight)
            since[o] = age[now]
    return motion.after(belief, goals, mobility, since)
