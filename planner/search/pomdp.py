"""A partially observable Markov decision process as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TOLERANCE = 1e-9
"""By how much a distribution may miss a sum of 1."""


@dataclass(frozen=True, eq=False)
class Pomdp:
    """States, actions and observations, by unique names, with their probabilities and rewards.

    `transitions` (A, S, S) is P(next state | action, state), `likelihoods` (A, S, O) P(observation
    | action, next state), `rewards` (A, S) what an action is worth in a state, `start` (S,) the
    first belief. With a discount of 1, some action must lead to a state that no action leaves or
    rewards. Other shapes and what is no distribution are ValueErrors.
    """

    states: tuple[str, ...]
    actions: tuple[str, ...]
    observations: tuple[str, ...]
    transitions: Floats
    likelihoods: Floats
    rewards: Floats
    start: Floats
    discount: float = 1.0

    def __post_init__(self) -> None:
        n, m, k = len(self.states), len(self.actions), len(self.observations)
        for kind, names in (
            ("state", self.states),
            ("action", self.actions),
            ("observation", self.observations),
        ):
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise ValueError(f"{kind} {twice}: the name is used twice; name each {kind} once")
        shapes = {
            "transitions": (m, n, n),
            "likelihoods": (m, n, k),
            "rewards": (m, n),
            "start": (n,),
        }
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape:
                raise ValueError(f"{name}: its shape is {array.shape}; give {shape}")
            if not np.isfinite(array).all():
                raise ValueError(f"{name}: a value is not finite; give finite numbers")
        for name in ("transitions", "likelihoods", "start"):
            array = getattr(self, name)
            if (array < 0).any() or (abs(array.sum(axis=-1) - 1) > TOLERANCE).any():
                at = np.argwhere((array < 0).any(axis=-1) | (abs(array.sum(axis=-1) - 1) > 1e-9))
                where = ", ".join(map(str, at[0])) if at.size else "the row"
                raise ValueError(
                    f"{name}: {where} is not a distribution; give numbers from 0 on whose sum is 1"
                )
        if not 0 < self.discount <= 1:
            raise ValueError(f"discount is {self.discount}; give a number in (0, 1]")
