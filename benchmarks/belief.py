"""Beliefs beside ProbLog, which evaluates the same program, and beside plain Python."""

from __future__ import annotations

import math
import time
import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Row, median_seconds, print_rows
from semmap.belief.inference import infer
from semmap.belief.observation_columns import Observations, observation_rates
from semmap.belief.occlusion import infer_with_occlusion
from semmap.belief.problog_program import problog_program
from semmap.belief.sighting_model import THESIS

__all__ = ["main"]


class Case(NamedTuple):
    """A belief to infer; each object has the same number of observations."""

    prior: NDArray[np.float64]
    observations: Observations
    mobility: NDArray[np.float64]
    volume: NDArray[np.float64]


def random_case(objects: int, places: int, looks: int) -> Case:
    """Half of the looks are in vain; no object is hidden elsewhere than at a place."""
    random = np.random.default_rng(7)
    rows = objects * looks
    return Case(
        random.dirichlet(np.ones(places), objects),
        Observations(
            np.repeat(np.arange(objects), looks),
            random.integers(0, places, rows),
            random.random(rows) * 3600,
            random.random(rows) < 0.5,
        ),
        random.random(objects),
        random.permutation(objects).astype(np.float64) + 1,
    )


def in_plain_python(case: Case) -> list[list[float]]:
    """Bayes' rule, one observation after another."""
    there, elsewhere = observation_rates(case.observations, case.mobility, THESIS)
    weights = [[math.log(p) for p in row] for row in case.prior.tolist()]
    seen = case.observations
    columns = (c.tolist() for c in (seen.object, seen.place, seen.seen, there, elsewhere))
    for o, p, was_seen, a, b in zip(*columns, strict=True):
        weights[o][p] += math.log(a / b) if was_seen else math.log((1 - a) / (1 - b))
    found = []
    for row in weights:
        top = max(row)
        parts = [math.exp(w - top) for w in row]
        total = sum(parts)
        found.append([part / total for part in parts])
    return found


def by_problog(case: Case) -> tuple[float, NDArray[np.float64]]:
    """Seconds of ProbLog, and its belief."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        from problog import get_evaluatable
        from problog.program import PrologString

    objects = [f"object {i}" for i in range(case.prior.shape[0])]
    places = [f"place {i}" for i in range(case.prior.shape[1])]
    program = problog_program(*case[:3], objects, places, case.volume)
    start = time.perf_counter()
    answers = get_evaluatable().create_from(PrologString(program)).evaluate()
    seconds = time.perf_counter() - start
    named = {tuple(str(a) for a in term.args): float(p) for term, p in answers.items()}
    belief = [[named.get((f"'{o}'", f"'{p}'"), 0.0) for p in places] for o in objects]
    return seconds, np.array(belief)


def closed_form(objects: int, places: int, looks: int, required: float) -> Row:
    """All beliefs at once beside the same in plain Python."""
    case = random_case(objects, places, looks)
    same = float(np.abs(infer(*case[:3]) - in_plain_python(case)).max())
    ours = median_seconds(lambda: infer(*case[:3]), times=101 if objects < 100 else 11)
    plain = median_seconds(lambda: in_plain_python(case), times=5)
    return Row(
        f"{objects:,} objects x {places} places x {looks} observations each",
        f"{1e3 * ours:.3g} ms",
        f"plain Python: {1e3 * plain:.3g} ms, {plain / ours:.0f}x; differs by {same:.0e}",
        f"under {1e3 * required:g} ms",
        ours < required and same < 1e-12,
    )


def with_occlusion(objects: int, places: int, looks: int, required: float) -> Row:
    """Beliefs with occlusion, beside ProbLog with as many observations in all as ours have each."""
    case = random_case(objects, places, looks)
    few = case._replace(observations=case.observations.take(np.arange(looks) * looks))
    ours = median_seconds(lambda: infer_with_occlusion(*case), times=21)
    theirs, belief = by_problog(few)
    same = float(np.abs(infer_with_occlusion(*few) - belief).max())
    return Row(
        f"{objects} objects x {places} places x {looks} observations each, with occlusion",
        f"{1e3 * ours:.3g} ms",
        f"ProbLog, {looks} observations in all: {theirs:.2g} s; differs by {same:.0e}",
        f"under {1e3 * required:g} ms",
        ours < required and same < 1e-12,
    )


def main() -> None:
    """Print the table."""
    print_rows(
        "Beliefs",
        [
            closed_form(20, 30, 10, 0.2e-3),
            closed_form(2000, 300, 10, 0.1),
            with_occlusion(5, 10, 3, 5e-3),
        ],
    )


if __name__ == "__main__":
    main()
