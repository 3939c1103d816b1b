"""Observations as columns: which object, which place, how long ago, and whether it was seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.belief.error import BeliefError
from semmap.belief.sighting_model import SightingRates

COLUMNS = ("object", "place", "age", "seen", "share", "hit", "false_alarm")


@dataclass(frozen=True)
class Observations:
    """Columns of equal length k, one entry for each look at one place for one object.

    Sequences of any kind are converted. Two looks at the same time are two entries.

    Attributes
    ----------
    object, place : (k,) rows and columns of the belief
    age : (k,) seconds since the observation, at least 0
    seen : (k,) bool; False: looked for at this place and not found
    share : (k,) the share of the place in view, in (0, 1]; None for all of it. Both rates are
        multiplied by it. It cancels where the object was seen
    hit, false_alarm : (k,) P(seen | there) and P(seen | not there) of the detector at any age; NaN
        where the model's apply, None where they always apply

    Raises
    ------
    BeliefError
        Columns of different lengths, ages below 0, or shares and rates out of their range.

    Examples
    --------
    >>> len(Observations([0, 0], [1, 2], [5.0, 0.0], [True, False]))
    2
    """

    object: NDArray[np.intp]
    place: NDArray[np.intp]
    age: NDArray[np.float64]
    seen: NDArray[np.bool_]
    share: NDArray[np.float64] | None = None
    hit: NDArray[np.float64] | None = None
    false_alarm: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        for name in ("object", "place"):
            self._set(name, _column(name, getattr(self, name), np.integer, np.intp))
        self._set("age", _column("age", self.age, np.number, np.float64))
        self._set("seen", _column("seen", self.seen, np.bool_, np.bool_))
        _refuse("age", self.age, np.isfinite(self.age), "give seconds since the observation")
        _refuse(
            "age",
            self.age,
            self.age >= 0,
            "the observation is from the future: check the clocks, or leave it out",
        )
        for name in ("share", "hit", "false_alarm"):
            if getattr(self, name) is not None:
                self._set(name, _column(name, getattr(self, name), np.number, np.float64))
        if self.share is not None:
            fits = (self.share > 0) & (self.share <= 1)
            _refuse("share", self.share, fits, "give the visible share of the place, in (0, 1]")
        for name in ("hit", "false_alarm"):
            rate = getattr(self, name)
            if rate is not None:
                fits = np.isnan(rate) | ((rate > 0) & (rate < 1))
                _refuse(name, rate, fits, "give a probability strictly between 0 and 1")
        lengths = {
            name: len(getattr(self, name)) for name in COLUMNS if getattr(self, name) is not None
        }
        if len(set(lengths.values())) > 1:
            raise BeliefError(f"observations have columns of different lengths: {lengths}")

    def _set(self, name: str, value: NDArray[Any]) -> None:
        object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.object)

    def take(self, rows: ArrayLike) -> Observations:
        """Observations of the given rows, which are indices or a mask."""
        chosen = np.asarray(rows)
        taken: dict[str, Any] = {}
        for name in COLUMNS:
            column = getattr(self, name)
            taken[name] = None if column is None else column[chosen]
        return Observations(**taken)


def observation_rates(
    observations: Observations, mobility: NDArray[np.float64], model: SightingRates
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """P(seen | there) and P(seen | not there) of each observation, before its share is applied.

    `mobility` (objects,) is of the objects, not of the observations. `BeliefError` if the model
    returns a rate that is not strictly between 0 and 1, or a detector sees what is there less often
    than what is not.
    """
    there, elsewhere = model.rates(observations.age, mobility[observations.object])
    for name, rate in (("there", there), ("not there", elsewhere)):
        if len(rate) and not (rate.min() > 0 and rate.max() < 1):
            first = int(np.argmin((rate > 0) & (rate < 1)))
            raise BeliefError(
                f"sighting model: P(seen | {name}) is {rate[first]} at age "
                f"{observations.age[first]:g} s: give rates strictly between 0 and 1"
            )
    if observations.hit is not None:
        there = np.where(np.isnan(observations.hit), there, observations.hit)
    if observations.false_alarm is not None:
        own = observations.false_alarm
        elsewhere = np.where(np.isnan(own), elsewhere, own)
    if (there < elsewhere).any():
        first = int(np.argmax(there < elsewhere))
        raise BeliefError(
            f"observation {first}: hit is {there[first]:g}, below false_alarm, which is "
            f"{elsewhere[first]:g}: exchange them"
        )
    return there, elsewhere


def _column(name: str, values: ArrayLike, kind: Any, dtype: Any) -> NDArray[Any]:
    column = np.asarray(values)
    if column.ndim != 1:
        raise BeliefError(f"observations: {name} has shape {column.shape}: give one dimension")
    if len(column) and not np.issubdtype(column.dtype, kind):
        raise BeliefError(f"observations: {name} is of type {column.dtype}: give {dtype.__name__}")
    return column.astype(dtype, copy=False)


def _refuse(name: str, column: NDArray[np.float64], fits: NDArray[np.bool_], fix: str) -> None:
    if not fits.all():
        first = int(np.argmin(fits))
        raise BeliefError(f"observation {first}: {name} is {column[first]:g}: {fix}")
