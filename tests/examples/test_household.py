"""A household of weeks, and what is learned from it, judged by moves that the map was not told."""

from __future__ import annotations

import importlib.util
import json
import sys
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import semmap
from semmap import Map
from semmap.belief.calibration import calibrate
from tests.conftest import MakeDatabase

SCRIPT = Path(__file__).parents[2] / "examples/household.py"
SINCE = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0) - timedelta(days=21)
HELD_OUT = 6  # days


@pytest.fixture(scope="module")
def household() -> ModuleType:
    spec = importlib.util.spec_from_file_location("household", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def build(db: semmap.Database, seed: int) -> Map:
    """A building of three rooms with furniture at random."""
    random = np.random.default_rng(seed)
    dwelling = db.create_map(f"home{seed}")
    for number, kind in enumerate(("kitchen", "living_room", "bedroom")):
        x = 5.1 * number
        outline = [(x, 0), (x + 5, 0), (x + 5, 4), (x, 4)]
        dwelling.add_room(f"r{number}", outline, floor=0, ceiling=2.6, type=kind)
        for place, type_ in enumerate(random.permutation(["table", "desk", "cabinet", "shelf"])):
            size = *random.uniform(0.5, 0.9, 2), random.uniform(0.4, 0.9)
            pose = (x + 1.2 + 2.4 * (place % 2), 1 + 2 * (place // 2), 0)
            dwelling.add_object(f"f{number}{place}", type=str(type_), size=size, pose=pose)
    return dwelling


@pytest.fixture(scope="module")
def dwelling(make_database: MakeDatabase) -> Iterator[Map]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        yield build(db, 3)


def test_later_beliefs_are_calibrated_by_the_truth(dwelling: Map, household: ModuleType) -> None:
    """At random times of days that nothing was learned from, by looks until then."""
    random = np.random.default_rng(5)
    things = household.add_things(dwelling)
    dwelling.add_agent("rover", type="robot", size=(0.4, 0.4, 1), pose=(0.5, 0.5, 0))
    weights = household.weights_of(dwelling, list(things))
    moves = household.live(random, things, weights, SINCE, 21)
    places = sorted({place for own in weights.values() for place in own})
    looks = household.patrol(random, moves, places, SINCE, 21)
    cut = SINCE + timedelta(days=21 - HELD_OUT)
    household.store(dwelling, [look for look in looks if look.at < cut], weights, "rover")
    dwelling.learn_belief()
    household.store(dwelling, [look for look in looks if look.at >= cut], weights, "rover")

    hours = np.sort(random.uniform(8, 22, 4 * HELD_OUT))
    moments = [cut + timedelta(days=n // 4, hours=float(h)) for n, h in enumerate(hours)]
    after = judged(dwelling, things, moves, moments)
    dwelling.forget_learned()
    before = judged(dwelling, things, moves, moments)
    assert calibrate(*after).error < 0.05
    assert calibrate(*after).log_score < 0.85 * calibrate(*before).log_score
    assert calibrate(*after).brier_score < calibrate(*before).brier_score
    # nearly all places are nearly sure not to have a thing: errors show in the others
    off = calibrate(*unsure(*after), groups=5).error
    assert off < 0.07
    assert off < calibrate(*unsure(*before), groups=5).error


def unsure(chance: NDArray[np.float64], true: NDArray[np.bool_]) -> tuple[Any, Any]:
    """Of forecasts those that are neither nearly 0 nor nearly 1."""
    rows = (chance > 0.05) & (chance < 0.95)
    return chance[rows], true[rows]


def judged(
    dwelling: Map, things: Mapping[str, str], moves: Sequence[Any], moments: Sequence[datetime]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The belief in each place at some moments, and whether the thing was there."""
    names = sorted(things)
    ids = [dwelling.execute("SELECT entity_id(%s)", name)[0][0] for name in names]
    chance, true = [], []
    for moment in moments:
        where = {}
        for name in names:
            own = [move for move in moves if move.thing == name]
            where[name] = own[bisect_right([move.at for move in own], moment) - 1].place
        for name, place, share in dwelling.execute(
            "SELECT t.name, p.name, b.probability FROM belief_at(%s, %s) b "
            "JOIN entity t ON t.id = b.entity_id LEFT JOIN entity p ON p.id = b.place_id",
            *(ids, moment),
        ):
            chance.append(share)
            true.append(where[name] == place)
    return np.array(chance), np.array(true)


def test_the_script_gives_a_map_its_weeks(
    database: str,
    household: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    truth = tmp_path / "moves.jsonl"
    with semmap.connect(database) as db:
        build(db, 4)
    monkeypatch.setenv("SEMMAP_DB", database)
    monkeypatch.setattr(sys, "argv", ["household.py", "home4", "--weeks=1", f"--truth={truth}"])
    household.main()
    rows = [json.loads(line) for line in truth.read_text().splitlines()]
    counts = [int(part.split()[0]) for part in capsys.readouterr().out.split(", ")]
    assert counts[:2] == [len(household.THINGS), len(rows)]
    with semmap.connect(database) as db:
        dwelling = db.map("home4")
        assert {row["thing"] for row in rows} <= {thing.name for thing in dwelling.objects}
        seen = dwelling.execute(
            "SELECT count(DISTINCT at) FROM observation WHERE distance IS NOT NULL"
        )
        assert seen == [(counts[2],)]
        assert all(row["at"] < datetime.now(UTC).isoformat() for row in rows)
