"""The thesis's experiments: the log, the numbers that follow from it, and the table in the docs."""

from __future__ import annotations

import math
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.examples.script import load_example

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return load_example("thesis_experiments")


def test_the_runs_have_the_moves_and_looks_of_the_thesis(example: ModuleType) -> None:
    assert [example.moves_of(run) for run in example.RUNS] == [2, 1, 2, 1, 1, 2, 2, 1]
    assert [len(example.looks_of(run)) for run in example.RUNS] == [7, 4, 6, 2, 3, 10, 7, 2]


@pytest.mark.parametrize("printed", ["0.50", "0.87", "0.94", "0.86"])
def test_explanations_give_the_printed_number(example: ModuleType, printed: str) -> None:
    """By the formula of the thesis, in and just outside of each range of ages."""

    def belief(sightings: int, age: float) -> float:
        fall = 0.1 * math.exp(-age / 10)
        weight = ((0.6 + fall) / (0.3 - fall)) ** sightings
        return weight / (weight + 2)

    found = example.explanations(printed)
    assert found
    for sightings, youngest, oldest in found:
        middle = (youngest + min(oldest, youngest + 100)) / 2
        assert f"{belief(sightings, middle):.2f}" == printed
        if youngest:
            assert f"{belief(sightings, youngest - 0.5):.2f}" != printed
        if oldest < math.inf:
            assert f"{belief(sightings, oldest + 0.5):.2f}" != printed


def test_what_explains_the_numbers_of_the_thesis(example: ModuleType) -> None:
    assert [str(e) for e in example.explanations("0.50")] == ["1 sighting older than 32 s"]
    assert "3 sightings of 10.2 to 11.9 s" in map(str, example.explanations("0.87"))
    assert "5 sightings older than 36 s" in map(str, example.explanations("0.94"))
    assert "2 sightings newer than 0.3 s" in map(str, example.explanations("0.86"))


def test_our_answers_are_the_true_places(example: ModuleType) -> None:
    for run, replay in example.replays():
        answer = tuple(example.PLACES[row.argmax()] for row in replay.beliefs[-1])
        assert answer == run.truth, run.name
        for belief in replay.beliefs:
            np.testing.assert_allclose(belief.sum(axis=1), 1, atol=1e-12)


def test_the_documentation_has_the_tables(example: ModuleType) -> None:
    text = (ROOT / "docs/belief.md").read_text("utf-8")
    written = text.split("<!-- thesis -->\n")[1].split("<!-- end -->")[0]
    assert written == example.documentation()
