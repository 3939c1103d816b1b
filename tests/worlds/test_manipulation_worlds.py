"""Missions take objects of real worlds, and what they tried is known then, to others, too."""

from __future__ import annotations

import json
from pathlib import Path

from sqlalchemy import Engine, text

import semmap as package
from semmap.manipulation.retrieval import find_grasps
from tests.command_line import semmap
from tests.manipulation.grippers import BY_HAND
from tests.seen import seen_by

BOX = "SeasoningBox_01_001"


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


def test_a_second_robot_of_another_gripper_does_not_begin_with_what_failed(
    house: Engine, tmp_path: Path
) -> None:
    """A grasp drops the box; of its kind, less is expected by the other gripper, too."""
    url = house.url.render_as_string(hide_password=False)
    words = ("--from", "kitchen", "--map", "house", "--assume-sizes", "--speed", 100000)
    mission = ("run", f"on({BOX}, KitchenTable_01_001)", "--simulate", *words)

    def tried(*more: object) -> list[tuple[str, str]]:
        """Families and outcomes of the grasps of a mission, in order."""
        done = semmap(url, *mission, "--json", "--world", tmp_path / str(len(more)), *more)
        assert done.exit_code == 0, done.output
        copy = json.loads(done.stdout)["map"]
        listed = semmap(url, "manipulation", "tasks", "--map", copy, "--json", "--limit", 100)
        with house.connect() as connection:
            query = text("SELECT id, family FROM action")
            families = {row.id: row.family for row in connection.execute(query)}
        rows = [row for row in json.loads(listed.stdout) if row["kind"] == "grasp"]
        return [(families[row["action_id"]], row["outcome"]) for row in reversed(rows)]

    *before, found = tried()
    failed = [(family, outcome) for family, outcome in before if outcome == "error"]
    assert failed, "the first robot learns by a failure"
    assert found[1] == "completed"
    hand = tmp_path / "plates.urdf"
    hand.write_text(BY_HAND)
    assert semmap(url, "manipulation", "add-gripper", hand, "--name", "plates").exit_code == 0
    families = {family for family, _ in failed}
    with package.connect(url) as db:
        session = db.map("house").connection

        def expected() -> float:
            """What is expected of the kinds of grasps that failed, by the other gripper."""
            found = find_grasps(seen_by(session), name=BOX, gripper="plates", limit=1000)
            shares = [row["expected"] for row in found.rows if row["family"] in families]
            return sum(shares) / len(shares)

        with session.transaction(force_rollback=True):
            knowing = expected()
            session.execute("DELETE FROM experience")
            assert knowing < expected() - 0.01
    ((family, outcome),) = tried("--gripper", "plates")
    assert family not in families
    assert outcome == "completed"
