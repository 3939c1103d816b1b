"""Random beliefs to infer, for several tests."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from semmap.belief.observation_columns import Observations, observation_rates
from semmap.belief.sighting_model import THESIS
from tests.oracles.bayes import Look


class Case(NamedTuple):
    prior: NDArray[np.float64]
    observations: Observations
    mobility: NDArray[np.float64]
    volume: NDArray[np.float64]


def random_case(
    random: np.random.Generator, objects: int, places: int, looks: int, sizes: int = 3
) -> Case:
    """Some priors are 0, some looks are in vain, partial, or of a detector with own rates."""
    prior = random.dirichlet(np.ones(places), objects)
    prior[random.random(prior.shape) < 0.2] = 0
    prior[np.arange(objects), random.integers(0, places, objects)] += 0.1
    prior /= prior.sum(axis=1, keepdims=True)
    detector = random.random((2, looks))
    model = random.random(looks) < 0.5
    return Case(
        prior,
        Observations(
            random.integers(0, objects, looks),
            random.integers(0, max(1, places - 1), looks),
            random.choice([0.0, 1.0, 5.0, 11.0, 1e4], looks) * random.random(looks),
            random.random(looks) < 0.5,
            share=random.choice([1.0, 0.5, 0.05], looks),
            hit=np.where(model, np.nan, 0.5 + 0.49 * detector[0]),
            false_alarm=np.where(model, np.nan, 0.01 + 0.4 * detector[1]),
        ),
        random.choice([0.0, 0.3, 1.0, 4.0], objects),
        1.0 + random.integers(0, sizes, objects),
    )


def looks_of(case: Case) -> list[Look]:
    """The observations of a case for the oracle, with the share in their rates."""
    there, elsewhere = observation_rates(case.observations, case.mobility, THESIS)
    seen = case.observations
    return [
        Look(int(o), int(p), float(s * a), float(s * b), bool(v))
        for o, p, s, a, b, v in zip(
            seen.object, seen.place, seen.share, there, elsewhere, seen.seen, strict=True
        )
    ]
