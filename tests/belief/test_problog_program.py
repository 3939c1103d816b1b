"""The exported program, run by ProbLog, against the closed form and the sums over sets."""

from __future__ import annotations

import numpy as np
import pytest

from semmap.belief.error import BeliefError
from semmap.belief.inference import infer
from semmap.belief.observation_columns import Observations
from semmap.belief.occlusion import infer_with_occlusion
from semmap.belief.problog_program import problog_program
from semmap.belief.sighting_model import SightingModel
from tests.belief.cases import random_case
from tests.oracles.problog_engine import places_by_problog


def by_problog(program: str, objects: list[str], places: list[str]) -> list[list[float]]:
    found = places_by_problog(program)
    return [[found.get((o, p), 0.0) for p in places] for o in objects]


@pytest.mark.parametrize("occlusion", [False, True])
@pytest.mark.parametrize("batch", range(2))
def test_problog_agrees(batch: int, occlusion: bool) -> None:
    """Each of 25 cases has negative, partial and detectors' sightings; half change the model."""
    random = np.random.default_rng([batch, occlusion])
    for number in range(25):
        case = random_case(random, *random.integers((1, 2, 1), (4, 5, 7)))
        objects = [f"mug {i}" for i in range(len(case.prior))]
        places = [f"Place{i}" for i in range(case.prior.shape[1])]
        model = SightingModel(seconds=3.0, change=0.05) if number % 2 else SightingModel()
        expected = infer(*case[:3], model)
        volume = None
        if occlusion:
            volume = case.volume
            expected = infer_with_occlusion(*case, hides=0.6, hidden=0.35, model=model)
        program = problog_program(
            *case[:3], objects, places, volume, hides=0.6, hidden=0.35, model=model
        )
        np.testing.assert_allclose(
            by_problog(program, objects, places), expected, rtol=0, atol=1e-12, err_msg=program
        )


def test_occlusion_changes_what_problog_answers() -> None:
    """In the thesis's program, occlusion has no effect on the sightings."""
    looks = Observations([0, 1], [0, 0], [0.0, 0.0], [False, True])
    arguments = ([[0.5, 0.5]] * 2, looks, [1.0, 1.0], ["coke", "cereal"], ["table", "counter"])
    without = places_by_problog(problog_program(*arguments))
    behind = places_by_problog(problog_program(*arguments, [6.6, 16.6]))
    assert without["coke", "table"] == pytest.approx(0.3 / (0.3 + 0.8))
    assert behind["coke", "table"] > without["coke", "table"] + 0.05


def test_any_name_is_an_atom() -> None:
    names = [
        "it's",
        "Über \\ alles",
        "X",
        "_",
        "a, b).",
        "is_in",
        "% no comment",
        "two\nlines",
        "杯",
    ]
    look = Observations([0, 3], [4, 8], [0.0, 0.0], [True, True])
    prior = np.full((len(names), len(names)), 1 / len(names))
    mobility = np.ones(len(names))
    program = problog_program(prior, look, mobility, names, names)
    expected = infer(prior, look, mobility)
    np.testing.assert_allclose(by_problog(program, names, names), expected, rtol=0, atol=1e-12)


def test_a_model_without_formula_is_written_as_numbers() -> None:
    class Steps:
        def rates(self, age, mobility):
            new = np.asarray(age) * mobility < 60
            return np.where(new, 0.95, 0.7), np.where(new, 0.02, 0.4)

    prior = np.full((1, 3), 1 / 3)
    looks = Observations([0, 0], [0, 1], [30.0, 600.0], [True, True])
    program = problog_program(prior, looks, [1.0], ["coke"], ["a", "b", "c"], model=Steps())
    assert "exp(" not in program
    expected = infer(prior, looks, [1.0], Steps())
    found = by_problog(program, ["coke"], ["a", "b", "c"])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("objects", "places", "text"),
    [
        (["coke"], ["a", "b"], "1 names of 2 objects: give one each"),
        (["coke", "cereal"], ["a"], "1 names of 2 places: give one each"),
        (["coke", "coke"], ["a", "b"], "two objects are named 'coke'"),
        (["coke", "cereal"], ["a", "a"], "two places are named 'a'"),
    ],
)
def test_names_that_do_not_fit(objects: list[str], places: list[str], text: str) -> None:
    nothing = Observations([], [], [], [])
    with pytest.raises(BeliefError, match=text):
        problog_program([[0.5, 0.5]] * 2, nothing, [1, 1], objects, places)
