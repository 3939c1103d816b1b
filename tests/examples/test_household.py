"""A household of weeks, and what is learned from it, judged by moves that the map was not told."""

from __future__ import annotations

import json
import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest

import semmap
from semmap.belief.calibration import calibrate
from tests.examples.script import load_example
from tests.households import furnished_home, learned_and_not, unsure


def test_later_beliefs_are_calibrated_by_the_truth(database: str) -> None:
    with semmap.connect(database) as db:
        after, before = learned_and_not(furnished_home(db, 3), 5)
    assert calibrate(*after).error < 0.05
    assert calibrate(*after).log_score < 0.85 * calibrate(*before).log_score
    assert calibrate(*after).brier_score < calibrate(*before).brier_score
    assert calibrate(*unsure(after), groups=5).error < 0.07


def test_the_script_gives_a_map_its_weeks(
    database: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    household = load_example("household")
    truth = tmp_path / "moves.jsonl"
    with semmap.connect(database) as db:
        furnished_home(db, 4)
    monkeypatch.setenv("SEMMAP_DB", database)
    monkeypatch.setattr(sys, "argv", ["household.py", "home4", "--weeks=1", f"--truth={truth}"])
    household.main()
    rows = [json.loads(line) for line in truth.read_text().splitlines()]
    counts = [int(part.split()[0]) for part in capsys.readouterr().out.split(", ")]
    assert counts[:2] == [len(household.THINGS), len(rows)]
    with semmap.connect(database) as db:
        home = db.map("home4")
        assert {row["thing"] for row in rows} <= {thing.name for thing in home.objects}
        seen = home.execute("SELECT count(DISTINCT at) FROM observation WHERE distance IS NOT NULL")
        assert seen == [(counts[2],)]
        assert all(row["at"] < datetime.now(UTC).isoformat() for row in rows)
