"""docs/tutorial.md runs from top to bottom on a real house, through the map alone."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import pytest

import semmap
from tests.robot.robots import real_robot

PAGE = Path(__file__).parents[2] / "docs/tutorial.md"
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_the_tutorial_prints_what_it_shows(
    database: str, worlds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real_robot("tiago")  # skips without the package
    monkeypatch.setenv("SEMMAP_DB", database)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small_house").symlink_to(worlds / "small_house")
    examples = "\n".join(BLOCK.findall(PAGE.read_text()))
    test = doctest.DocTestParser().get_doctest(examples, {}, PAGE.name, PAGE.name, 0)
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    found = doctest.DocTestRunner(optionflags=options).run(test)
    assert found.attempted > 30
    assert found.failed == 0
    for file in ("grid/map.yaml", "grid/plan.png", "kitchen/nav2_params.yaml", "route.png"):
        assert (tmp_path / "out" / file).stat().st_size > 100
    with semmap.connect(database) as db:  # the simulated run left the map as it was
        mug = db.map("house")["mug1"].holder
        assert mug is not None
        assert mug.name == "KitchenTable_01_001"
