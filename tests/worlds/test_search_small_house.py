"""A mug in the small house: behind a box, moved, and in a wardrobe that must be opened."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Engine

import semmap
from tests.command_line import semmap as semmap_command
from tests.robot.robots import real_robot
from tests.worlds.conftest import store_slim_robot

TABLE = "KitchenTable_01_001"


@pytest.fixture(scope="module")
def url(house: Engine) -> str:
    """A database that holds the small house, with a mug behind a box."""
    text = house.url.render_as_string(hide_password=False)
    with semmap.connect(text) as database:
        home = database.map("house")
        _, _, top = home.spot(home[TABLE], "on")
        for name, kind, size, y in (
            ("mug", "mug", (0.09, 0.09, 0.1), 1.12),
            ("box", "box", (0.6, 0.1, 0.4), 0.85),
        ):
            home.add_object(name, type=kind, on=TABLE, size=size, pose=(6.3, y, float(top), 0.0))
    store_slim_robot(house)
    return text


def search(url: str, folder: Path, *more: object) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The end of a simulated search for the mug, and its steps."""
    words = ("--simulate", "--apply", "--speed", 100000, "--from", "bedroom", "--json")
    words += ("--robot", "slim", "--world", folder / f"{len([*folder.iterdir()])}.sqlite")
    found = semmap_command(url, "search", "mug", "--map", "house", *words, *more)
    answer = json.loads(found.stdout)
    assert answer["state"] == "done"
    assert "not_found" not in answer
    mug = answer["found"]["mug"]
    assert mug["seen"] or mug["looks"] == 0  # it may be sure enough without a look
    assert len([s for s in answer["steps"] if s["action"] == "look"]) == mug["looks"]
    return mug, answer["steps"]


def test_a_mug_behind_a_box_is_found_and_found_again_after_it_moved(url: str, tmp_path: Path):
    mug, _ = search(url, tmp_path)
    assert mug["place"] == TABLE
    assert mug["looks"] > 1  # from the first side, the box hides it
    mug, _ = search(url, tmp_path, "--put", "mug on CoffeeTable_01_001")
    assert mug["place"] == "CoffeeTable_01_001"
    again, _ = search(url, tmp_path)
    assert again["place"] == "CoffeeTable_01_001"
    assert again["looks"] < mug["looks"]


def test_a_mug_in_a_shut_wardrobe_is_found_when_it_is_open(url: str, tmp_path: Path):
    """The map says nothing of its doors: nothing sees into its mesh."""
    mug, steps = search(url, tmp_path, "--put", "mug in Wardrobe_01_001", "--camera-pitch", 0.3)
    assert mug["place"] == "Wardrobe_01_001"
    opened = [step for step in steps if step["action"] == "open_container"]
    assert opened[-1]["arguments"] == ["Wardrobe_01_001"]
    seen_at = steps.index(opened[-1])
    assert all("is seen at Wardrobe" not in (step["message"] or "") for step in steps[:seen_at])


def test_a_robot_holds_its_camera_as_its_urdf_says_and_opens_nothing_if_it_cannot(url: str):
    with semmap.connect(url) as database:
        home = database.map("house")
        assumed = home.search("mug", start="bedroom")
        assert assumed.assumed_camera is not None
        assert {view.aim.height for view in assumed.problem.viewpoints} == {1.2}
        assert any(view.opens == "Wardrobe_01_001" for view in assumed.problem.viewpoints)
        database.add_robot("tiago", real_robot("tiago"), opens=False)
        search = home.search("mug", start="bedroom", robot="tiago")
    assert search.assumed_camera is None
    views = search.problem.viewpoints
    assert not any(view.opens for view in views)
    assert "Wardrobe_01_001" in search.problem.closed
    assert assumed.problem.closed == ()
    heights = sorted({view.aim.height for view in views})
    assert heights[0] >= 1.06
    assert heights[-1] <= 1.42  # its lift is 0.35 m high
    assert len({view.aim.pitch for view in views}) > 1
    assert all(abs(view.aim.pan) <= 1.31 for view in views)
    for told, view in zip(search.as_json()["tour"], search.tour, strict=True):
        assert told["camera"]["z"] == pytest.approx(view.pose.z + view.aim.height)
