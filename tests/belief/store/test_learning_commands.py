"""What is learned and asked at the command line, beside the methods."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

import semmap
from semmap.belief.error import BeliefError
from semmap.belief.store.learning import PARTS
from tests import command_line
from tests.conftest import MakeDatabase

NOW = datetime.now(UTC)


@pytest.fixture(scope="module")
def url(make_database: MakeDatabase) -> str:
    """A hall with two tables and two mugs that were looked for in ten days."""
    found = make_database().render_as_string(hide_password=False)
    with semmap.connect(found) as db:
        home = db.create_map("home")
        home.add_room("hall", [(0, 0), (6, 0), (6, 4), (0, 4)], floor=0, ceiling=2.6)
        for name, x in (("a", 1), ("b", 3)):
            home.add_object(name, type="table", size=(0.8, 0.8, 0.7), pose=(x, 2, 0))
        for number, place in ((1, "a"), (2, "b")):
            home.add_object(f"mug{number}", type="mug")
            for age in range(1, 20):
                at = NOW - timedelta(hours=12 * age)
                for table in "ab":
                    home.observe(f"mug{number}", table, seen=table == place, at=at)
    return found


def test_learning_shows_and_draws_what_it_found(url: str, tmp_path: Path) -> None:
    picture = tmp_path / "calibration.png"
    words = ("belief", "learn", "--hold-out", "3", "--time-zone", "Asia/Tokyo")
    told = command_line.semmap(url, *words, "--draw", picture)
    assert told.exit_code == 0
    for name in ("nothing learned:", "learned, without hours:", "learned:"):
        assert name in told.stdout
    assert picture.read_bytes()[:4] == b"\x89PNG"
    found = json.loads(command_line.semmap(url, *words, "--json").stdout)
    assert found["after"]["log_score"] < found["before"]["log_score"]
    assert all(len(row["by_part"]) == len(PARTS) for row in found["lifts"])
    with pytest.raises(BeliefError, match="Mars/Olympus; give a name as Europe/Berlin"):
        command_line.semmap(url, "belief", "learn", "--time-zone", "Mars/Olympus")


def test_which_was_there_is_that_of_the_method(url: str) -> None:
    at = NOW - timedelta(hours=30)
    words = ("belief", "which", "mug", "a", "--at", at.isoformat())
    rows = json.loads(command_line.semmap(url, *words, "--json").stdout)
    with semmap.connect(url) as db:
        found = db.map("home").which("mug", "a", at)
    assert {row["object"]: row["probability"] for row in rows} == pytest.approx(found, abs=1e-4)
    assert [row["object"] for row in rows] == ["mug1", "mug2"]
    said = command_line.semmap(url, "ask", "which mug was on the a yesterday").stdout
    assert said.startswith("mug1 ")


def test_what_was_learned_is_forgotten(url: str) -> None:
    command_line.semmap(url, "belief", "learn")
    assert command_line.semmap(url, "belief", "forget").stdout.endswith(" lifts forgotten\n")
    assert command_line.semmap(url, "belief", "forget").stdout == "0 lifts forgotten\n"
