"""`semmap costmap` as a user calls it, on the office."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Engine

from tests.command_line import semmap

OFFICE = Path(__file__).parents[2] / "examples" / "office"
ROBOT, PARTS = OFFICE / "delivery_robot.urdf", OFFICE / "delivery_robot_parts.yaml"


@pytest.fixture(scope="module")
def office(office_world: Engine) -> str:
    """The URL of a database that holds the office."""
    return office_world.url.render_as_string(hide_password=False)


def run(office: str, *words: object) -> Any:
    done = semmap(office, "costmap", "--robot", ROBOT, "--parts", PARTS, *words, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_each_storey_has_a_folder_with_the_files_for_nav2(office: str, tmp_path: Path) -> None:
    written = run(office, "-o", tmp_path, "--resolution", "0.1", "--headings", "4")
    assert [w["storey"] for w in written] == ["floor-1st", "floor-3rd"]
    for files in written:
        folder = tmp_path / files["storey"]
        for file in files["maps"].values():
            assert (folder / file).with_suffix(".pgm").is_file()
        assert {"nav2_params.yaml", "costmap.json", "master.png", "collisions.npz"} <= {
            p.name for p in folder.iterdir()
        }
        assert [p["name"] for p in files["parts"]] == ["base", "arm", "pole"]
    assert "keepout_mask" in written[0]["maps"]
    assert "speed_mask" in written[1]["maps"]


def test_joints_change_the_arm_and_its_costmap(office: str, tmp_path: Path) -> None:
    near = ("-o", tmp_path, "--rooms", "lab2", "--no-picture")
    (ahead,) = run(office, *near)
    state = tmp_path / "state.json"
    state.write_text('{"lift_joint": 1.2, "elbow_joint": 1.0}')
    (down,) = run(office, *near, "--state", state)
    intervals = [{p["name"]: p["interval"] for p in w["parts"]} for w in (ahead, down)]
    assert intervals[0]["base"] == intervals[1]["base"]
    assert intervals[1]["arm"][0] < intervals[0]["arm"][0] - 0.2
    assert down["lethal"] != ahead["lethal"], "now it meets the workbenches"


def test_explain_lists_the_entities_at_a_point(office: str) -> None:
    (files,) = run(office, "--explain", "9.2,0.45", "--storey", "floor-3rd")
    assert files["cost"] == 254
    first = files["because"][0]
    assert (first["layer"], first["cost"]) == ("admissible_objects", 254)
    assert "desk4" in {name for b in files["because"] for name in b["entities"]}


def test_a_box_limits_the_grid(office: str, tmp_path: Path) -> None:
    (files,) = run(
        office, "-o", tmp_path, "--storey", "floor-3rd", "--box", "5,1,9,3", "--no-picture"
    )
    assert files["width"] * files["resolution"] < 4 + 2 * 1.3
    assert files["origin"][0] < 5


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--explain", "1"), "takes 2 numbers"),
        (("--why", "100,100"), "on none of the grids"),
        (("-o", "x", "--box", "1,1,0,0"), "upside down"),
        (("-o", "x", "--rooms", "lab9", "--storey", "floor-3rd"), "no room named lab9"),
        (("-o", "x", "--storey", "attic"), "no storey named attic"),
        (("-o", "x", "--state", "{"), "is not JSON"),
        (("-o", "x", "--state", "[1]"), "neither JSON nor a file"),
        (("-o", "x", "--state", '{"lift_joint": 9}'), "goes from -1.2 to 1.2"),
        (("-o", "x", "--policy", "none.yaml"), "cannot be read"),
        (("-o", "x", "--max-step", "-1"), "0 m or more"),
        (("-o", "x", "--resolution", "0"), "above 0"),
    ],
)
def test_invalid_options_are_refused_and_write_no_file(
    office: str,
    words: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises((ValueError, LookupError), match=message):
        run(office, *words)
    assert list(tmp_path.iterdir()) == []
