"""How probable a sighting is, at the object's place and elsewhere (O'Neill, section 4.4.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.belief.error import BeliefError


class SightingRates(Protocol):
    """Any model of how sightings lose their value with age."""

    def rates(
        self, age: ArrayLike, mobility: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """P(seen | there) and P(seen | not there), both strictly between 0 and 1.

        `age` is in seconds, at least 0; `mobility`, at least 0, is broadcast with it.
        """
        ...


@dataclass(frozen=True)
class SightingModel:
    """The model of the thesis, whose sightings lose value with age.

    P(seen | there) = there + change · d and P(seen | not there) = elsewhere - change · d, where
    d = exp(-age · mobility / seconds). The thesis prints the exponent with age below 0; then
    probabilities leave [0, 1] after 11 s. Here, age is at least 0.

    Raises
    ------
    BeliefError
        A probability would not be strictly between 0 and 1, a sighting would be less probable at
        the object's place than elsewhere, or `seconds` is not above 0.

    Examples
    --------
    >>> SightingModel().rates(0.0, 1.0)
    (array(0.7), array(0.2))
    """

    there: float = 0.6
    elsewhere: float = 0.3
    change: float = 0.1
    seconds: float = 10.0

    def __post_init__(self) -> None:
        for name in ("there", "elsewhere", "change", "seconds"):
            if not math.isfinite(getattr(self, name)):
                raise BeliefError(f"sighting model: {name} is {getattr(self, name)}: give a number")
        if self.change < 0:
            raise BeliefError(f"sighting model: change is {self.change:g}: give at least 0")
        if self.seconds <= 0:
            raise BeliefError(f"sighting model: seconds is {self.seconds:g}: give more than 0")
        if not 0 < self.elsewhere - self.change <= self.there + self.change < 1:
            raise BeliefError(
                f"sighting model: P(seen | there) is up to {self.there + self.change:g} and "
                f"P(seen | not there) from {self.elsewhere - self.change:g}: choose there, "
                "elsewhere and change so that 0 < elsewhere - change and there + change < 1"
            )
        if self.there < self.elsewhere:
            raise BeliefError(
                f"sighting model: there is {self.there:g}, below elsewhere, which is "
                f"{self.elsewhere:g}: exchange them"
            )

    def rates(
        self, age: ArrayLike, mobility: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """P(seen | there) and P(seen | not there) for ages in seconds and mobilities."""
        with np.errstate(over="ignore"):
            exponent = np.asarray(age, np.float64) * np.asarray(mobility, np.float64)
            fall = self.change * np.exp(-exponent / self.seconds)
        return np.asarray(self.there + fall), np.asarray(self.elsewhere - fall)


THESIS = SightingModel()
"""The model with the numbers of the thesis."""
