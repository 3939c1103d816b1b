"""A robot of the hotel takes a can from a room to the reception, and its grasp is known then."""

from __future__ import annotations

import json
from pathlib import Path

from sqlalchemy import Engine

import semmap as package
from tests.command_line import semmap
from tests.manipulation.grippers import BY_HAND


def test_a_mission_stores_the_attempt_of_the_grasp_that_it_used(
    hotel: Engine, worlds: Path, tmp_path: Path
) -> None:
    url = hotel.url.render_as_string(hide_password=False)
    can = worlds / "ycb" / "meshes" / "005_tomato_soup_can_textured.gltf"
    with package.connect(url) as db:
        map_ = db.map("hotel")
        table = (0.8, 0.5, 0.72)
        map_.add_object("night_table", type="table", size=table, pose=(17.5, -16.0, 8.0))
        map_.add_object("reception", type="table", size=table, pose=(12.0, -28.5, 0.0))
        map_.add_object("can", type="can", mesh=can, pose=(17.4, -16.0, 8.7705))
    hand = tmp_path / "plates.urdf"
    hand.write_text(BY_HAND)
    assert semmap(url, "manipulation", "add-gripper", hand, "--name", "plates").exit_code == 0
    words = ("--simulate", "--apply", "--speed", 100000, "--world", tmp_path / "sim")
    mission = ("run", "on(can, reception)", "--from", "lobby", "--gripper", "plates", *words)
    done = semmap(url, *mission, "--map", "hotel")
    assert done.exit_code == 0, done.output
    listed = semmap(url, "grasp", "can", "--gripper", "plates", "--map", "hotel", "--json")
    grasps = json.loads(listed.stdout)
    tried = [row for row in grasps if row["attempts"] > 0]
    assert len(tried) == 1
    assert tried[0] == max(grasps, key=lambda row: row["expected"])
    assert abs(tried[0]["pose"][0] - 12.0) < 0.5  # where the can is now
    tasks = json.loads(semmap(url, "manipulation", "tasks", "--map", "hotel", "--json").stdout)
    assert {(task["kind"], task["outcome"]) for task in tasks} == {
        ("grasp", "completed"),
        ("place", "completed"),
        ("put", "completed"),
    }
    assert tried[0]["action_id"] in {task["action_id"] for task in tasks}
