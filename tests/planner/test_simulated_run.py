"""Where a simulated mission keeps the state of its world."""

from __future__ import annotations

from pathlib import Path

import pytest
import shapely

import semmap


def test_the_name_of_a_map_is_no_path(
    database: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    monkeypatch.chdir(folder)
    with semmap.connect(database) as db:
        place = db.create_map("../../../outside")
        place.add_room("left", shapely.box(0, 0, 3, 3))
        place.add_room("right", shapely.box(3, 0, 6, 3))
        place.add_door("door", "left", "right", ((3, 1), (3, 2)))
        ended = place.run("in(robot, right)", start="left", speed=500.0)
    assert ended.done
    assert [ended.world.resolve()] == [file.resolve() for file in tmp_path.rglob("*.sqlite")]
    assert ended.world.resolve().is_relative_to(folder)
