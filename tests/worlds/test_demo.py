"""`semmap demo` on the small house: the same demo as on the example, at places of that house."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from semmap import connect
from semmap.cli.chosen import CliOptions
from semmap.cli.demo.run import run_demo
from tests.conftest import MakeDatabase
from tests.office import OFFICE_ROBOT
from tests.worlds.conftest import HOUSE, ROOMS

PICTURES = {
    "figure6_parts.png",
    "figure7_footprints.png",
    "figure9_layered.png",
    "figure9_single.png",
    "figure9_robot.png",
    "fields.png",
    "search.png",
    "topology.png",
    "plan.png",
    "rooms.png",
    "objects.png",
}


@dataclass
class Demo:
    url: str
    said: str
    pictures: list[Path]


@pytest.fixture(scope="module")
def demo(
    make_database: MakeDatabase, worlds: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Demo]:
    url = make_database().render_as_string(hide_password=False)
    before, CliOptions.url = CliOptions.url, url
    said: list[str] = []
    folder = tmp_path_factory.mktemp("demo")
    files = [worlds / HOUSE, ROOMS]
    pictures = run_demo(
        files, folder, OFFICE_ROBOT, pixels=400, say=lambda line: said.append(str(line))
    )
    yield Demo(url, "\n".join(said), pictures)
    CliOptions.url = before


def test_it_brings_a_small_object_from_one_table_to_another(demo: Demo) -> None:
    plan = re.search(r"on\((\w+), (\w+)\): (.+)", demo.said)
    assert plan is not None
    wanted, table, steps = plan.groups()
    (picked,) = re.findall(rf"pickup\({wanted}, (\w+)\)", steps)
    with connect(demo.url) as db:
        house = db.map("small_house")
        assert not [each for each in house.check() if each.severity == "error"]
        held = [entity.name for entity in house[picked].contents]
        wanted_ones = {entity.name for entity in house.find(wanted)}
        assert wanted_ones & {*held}, "the task was in a copy: the map is as before"
        assert not wanted_ones & {entity.name for entity in house[table].contents}
    assert steps.endswith(f"place({wanted}, {table})")
    done = re.search(r"done: (\d+) steps by a simulated robot", demo.said)
    assert done is not None
    assert int(done[1]) > steps.count("·")


def test_it_draws_the_figures_and_says_which_one_the_house_lacks(demo: Demo) -> None:
    assert {p.name for p in demo.pictures} >= PICTURES
    for picture in demo.pictures:
        pixels = np.asarray(Image.open(picture).convert("RGB"), float)
        assert pixels.std() > 5, f"{picture.name} is empty"
    assert "no Figure 5: the map has no region that is blocked" in demo.said
    assert not any("figure5" in p.name for p in demo.pictures)
    with connect(demo.url) as db:
        looked_at = re.search(r":containsObject '(\w+)'", demo.said)
        assert looked_at is not None
        assert db.map("small_house").find(looked_at[1])
    voxels = re.search(r"(\d+) voxels of 0.02 m", demo.said)
    assert voxels is not None
    assert int(voxels[1]) > 0
