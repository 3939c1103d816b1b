"""Random searches for tests."""

from __future__ import annotations

import numpy as np

from planner.search.search_problem import SearchProblem


def random_search(
    seed: int,
    objects: int = 1,
    places: int = 3,
    viewpoints: int = 3,
    *,
    hit: float = 0.9,
    false_alarm: float = 0.0,
    wrong: float = 60.0,
    elsewhere: bool = False,
    shut: int = 0,
) -> tuple[SearchProblem, np.ndarray]:
    """A search with random viewpoints, each of which shows a place, and a random belief."""
    draw = np.random.default_rng(seed)
    at = draw.uniform(0, 10, (viewpoints, 2))
    visible = np.zeros((viewpoints, places))
    for v in range(viewpoints):
        visible[v, v % (places - elsewhere)] = 1
    opening = np.where(np.arange(viewpoints) < shut, 5.0, 0.0)
    problem = SearchProblem(
        tuple(f"object{k}" for k in range(objects)),
        tuple(f"place{k}" for k in range(places)),
        tuple(f"view{k}" for k in range(viewpoints)),
        np.arange(places),
        visible,
        np.linalg.norm(at[:, None] - at[None], axis=2),
        np.linalg.norm(at, axis=1),
        2.0,
        np.full(objects, hit),
        np.full(objects, false_alarm),
        wrong,
        opening,
    )
    return problem, draw.dirichlet(np.ones(places), objects)
