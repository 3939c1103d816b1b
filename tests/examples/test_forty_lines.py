"""A script of forty lines does the main job on a real house, through the map alone."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import semmap
from tests.robot.robots import real_robot
from tests.worlds.conftest import HOUSE, ROOMS

SCRIPT = Path(__file__).parents[2] / "examples/forty_lines.py"
ANGLES = (0.2, -1.34, -0.2, 1.94, -1.57, 1.37)
"""Of TIAGo's arm, folded, radians."""


def test_forty_lines_do_the_main_job(
    database: str, worlds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SEMMAP_DB", database)
    monkeypatch.syspath_prepend(SCRIPT.parent)
    monkeypatch.delitem(sys.modules, "forty_lines", raising=False)
    from forty_lines import run  # type: ignore[import-not-found]

    folded = {f"arm_{number}_joint": angle for number, angle in enumerate(ANGLES, 1)}
    urdf = str(real_robot("tiago"))
    found = run(str(worlds / HOUSE), str(ROOMS), urdf, folded, str(tmp_path))
    assert found["events"] == ["added", "moved"]
    assert found["rooms"] == ["bedroom", "living-room", "kitchen"]
    assert found["cost"] == ("KitchenTable_01_001",)
    assert found["actions"][2:] == [
        "pickup(mug1, KitchenTable_01_001)",
        "pass_door(kitchen-door, kitchen, living-room)",
        "place(mug1, CoffeeTable_01_001)",
    ]
    assert found["where"] == "KitchenTable_01_001"
    assert found["grasps"] > 0
    assert ("mug1",) in found["on the table"]
    assert (tmp_path / "map.yaml").is_file()
    with semmap.connect(database) as db:
        assert db.maps == ["forty"]


def test_it_has_forty_lines() -> None:
    code = [line for line in SCRIPT.read_text().splitlines() if line.strip()]
    assert len(code) <= 40
