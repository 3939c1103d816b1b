"""The commands and the Python of docs/belief.md, on a map with the names that the page has."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

import semmap
from tests import command_line

PAGE = (Path(__file__).parents[2] / "docs/belief.md").read_text("utf-8")
LATER = ("--cloud", "export", "identify", "field")
"""Of commands that need what the page does not show: a cloud of points, or other objects."""


@pytest.fixture
def house(database: str) -> Iterator[semmap.Map]:
    with semmap.connect(database) as db:
        house = db.create_map("house")
        house.add_room("kitchen", [(-2, -3), (6, -3), (6, 4), (-2, 4)], ceiling=2.7, type="kitchen")
        house.add_object("table1", type="table", size=(1.2, 0.8, 0.75), pose=(2.5, 2, 0))
        house.add_object("table2", type="table", size=(1.2, 0.8, 0.75), pose=(4.5, -1.5, 0))
        house.add_object("mug1", type="mug", size=(0.08, 0.08, 0.1), on="table2")
        house.add_agent("robot1", type="robot", size=(0.5, 0.5, 1.2), pose=(2.2, 1.9, 0))
        yield house


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_the_commands_and_the_python_run(
    house: semmap.Map, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SEMMAP_DB", house.database.address)
    (lesson,) = blocks("json")
    Path("breakfast.json").write_text(lesson)
    run = 0
    for line in re.findall(r"^\$ semmap (.*)$", "\n".join(blocks("console")), re.MULTILINE):
        if not any(word in line for word in LATER):
            done = command_line.semmap(house.database.address, *shlex.split(line))
            assert done.exit_code == 0, line
            run += 1
    assert run >= 9
    for code in blocks("python"):
        exec(compile(code, "belief.md", "exec"), {})
