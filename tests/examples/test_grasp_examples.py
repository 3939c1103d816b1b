"""The examples of grasps: a short experiment, its statistics, its curve, and the pictures."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.stats import binomtest, t

from tests.manipulation.grippers import urdf

ROOT = Path(__file__).parents[2]


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / f"examples/{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def experiment() -> ModuleType:
    urdf("panda")  # skips where the robots are not installed
    return load("grasp_experiment")


def test_a_short_life_is_repeatable_and_learns_what_it_meets_again(experiment: ModuleType) -> None:
    meetings = experiment.run("panda", 2000, 2)
    assert meetings == experiment.run("panda", 2000, 2)
    assert len(meetings) == 2
    assert any(m.learned for m in meetings)
    for meeting in meetings:
        assert meeting.attempts >= 1
        assert meeting.knowing == (meeting.learned and meeting.attempts == 1)
        assert meeting.learned or not meeting.again


@pytest.mark.parametrize(("successes", "trials"), [(92, 100), (0, 7), (7, 7), (1, 3)])
def test_intervals_are_those_of_wilson(experiment: ModuleType, successes: int, trials: int) -> None:
    share, low, high = experiment.interval(successes, trials)
    scipy = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    assert share == successes / trials
    assert (low, high) == pytest.approx((scipy.low, scipy.high), abs=1e-4)


def test_differences_are_by_pairs(experiment: ModuleType) -> None:
    random = np.random.default_rng(3)
    meetings = [
        experiment.Meeting(bool(blind < 0.6), bool(knowing < 0.9), 1, True, True)
        for blind, knowing in random.random((400, 2))
    ]
    apart = np.array([float(m.knowing) - float(m.blind) for m in meetings])
    low, high = t.interval(0.95, 399, apart.mean(), apart.std(ddof=1) / 20)
    text = f"{100 * apart.mean():+.0f} % | {100 * low:+.0f} to {100 * high:+.0f} %"
    assert text in experiment.difference(meetings)


def test_the_curve_and_the_tables_of_lives(experiment: ModuleType, tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    lives = [
        [experiment.Meeting(*map(bool, random.random(2) < 0.7), 2, True, True) for _ in range(20)]
        for _ in range(3)
    ]
    told = "\n".join(experiment.table("panda", lives))
    assert "panda: 3 runs of 20 objects" in told
    assert "| found by trial and error | 60 | 100 %" in told
    experiment.draw({"panda": lives}, tmp_path / "new" / "curve.png")
    assert imread(tmp_path / "new" / "curve.png")[..., :3].std() > 0.05


def test_the_pictures_show_grasps(
    experiment: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures = load("grasp_pictures")
    monkeypatch.setattr(pictures, "SHOWN", 3)
    monkeypatch.setattr("sys.argv", ["grasp_pictures", str(tmp_path)])
    pictures.main()
    drawn = {file.name: imread(file)[..., :3] for file in tmp_path.glob("*.png")}
    assert set(drawn) == {"grasps.png", "grippers.png"}
    assert all(picture.std() > 0.02 for picture in drawn.values())
