"""A run of a number of cases continues where it was interrupted."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fuzz.__main__ import Run
from tests.fuzz.pool import Worker


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    made = Worker("tests.fuzz.self_test")
    yield made
    made.close()


def test_an_interrupted_run_continues(worker: Worker, tmp_path: Path) -> None:
    progress = tmp_path / "progress.json"
    first = Run(["self test"], 60, "7", tmp_path, cases=3, progress=progress)
    first.work(worker)
    first.running.add(("self test", 1))  # a case that had not ended
    first.store()
    second = Run(["self test"], 60, "8", tmp_path, cases=6, progress=progress)
    assert (second.seed, second.done) == ("7", 3)
    second.work(worker)
    second.store()
    stored = json.loads(progress.read_text())
    assert stored["counts"] == {"self test": {"accepted": 6}}
    assert stored["numbers"] == {"self test": 5}  # 0 to 4, and 1 again
    assert stored["running"] == []
    assert "self test                  6          0          6" in second.table()
