"""A suction cup in a map: kept, asked for grasps and places, and refused with reasons."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

import semmap as package
from semmap import Map
from semmap.geometry.pose import Pose
from semmap.manipulation.automata import stored_arm
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.practice import practise, practise_places
from semmap.manipulation.retrieval import known_grasps, stored_gripper
from semmap.manipulation.store.models import object_model_id
from semmap.manipulation.suction import Cup
from tests.command_line import semmap
from tests.conftest import MakeDatabase
from tests.manipulation.grippers import BY_HAND, SUCTION, urdf
from tests.seen import seen_by


@pytest.fixture
def table(cups: Map, tmp_path: Path) -> Map:
    """The kitchen, with a cup of 30 mm and 60 N."""
    path = tmp_path / "one_cup.urdf"
    path.write_text(SUCTION)
    cups.database.add_gripper(path, "suction", suction=0.015, force=60)
    tablet = trimesh.creation.box((0.24, 0.16, 0.01))
    cups.add_object("tablet", type="laptop", mesh=tablet, pose=(1.9, 1.7, 0.7555))
    return cups


def test_a_cup_is_kept_with_its_radius_and_force(table: Map) -> None:
    (row,) = [each for each in table.database.list_grippers() if each["name"] == "suction"]
    assert (row["form"], row["opening"], row["force"]) == ("suction", 0.03, 60)
    kept = stored_gripper(table.connection, "suction")
    assert (kept.kind, kept.palm, kept.cup) == ("suction", "suction_cup", Cup(0.015, 60))
    assert row["depth"] == pytest.approx(0.06)


def test_what_lies_flat_is_held_from_above(table: Map) -> None:
    """The tablet is 16 cm wide and 1 cm high."""
    found = table.grasps("tablet", gripper="suction", limit=40)
    assert found.problems == []
    assert found.generated == ["tablet"]
    best = found[0]
    assert best["approach"] == "top"
    assert (best["width"], best["posture"]) == (None, {})
    assert best["pose"].matrix[:3, 2] == pytest.approx([0, 0, -1], abs=1e-6)
    assert best["pose"][:3] == pytest.approx((1.9, 1.7, 0.7605), abs=0.01)
    assert all(row["approach"] == "top" for row in found), "below it is the table"
    again = table.grasps("tablet", gripper="suction")
    assert again.generated == []
    assert again[0]["action_id"] == best["action_id"]


def test_a_heavy_thing_is_refused_with_the_reason(table: Map) -> None:
    assert len(table.grasps("tablet", gripper="suction")) > 0
    table.connection.execute(
        "UPDATE entity SET properties = properties || '{\"mass\": 7}' WHERE name = 'tablet'"
    )
    found = table.grasps("tablet", gripper="suction")
    assert list(found) == []
    assert found.problems[0].startswith("tablet: at all "), "on top of a cup, it would rest"
    assert found.problems[1].startswith("tablet: is too heavy for the suction cup of 60 N at ")
    table.connection.execute(
        "UPDATE entity SET properties = properties || '{\"mass\": 3}' WHERE name = 'tablet'"
    )
    near = table.grasps("tablet", gripper="suction", limit=100)
    middles = np.array([row["pose"][:2] for row in near]) - (1.9, 1.7)
    assert len(near) > 0
    assert np.hypot(*middles.T).max() < 0.008, "3 kg hang at 7.8 mm beside the middle at most"


def test_each_thing_is_refused_for_its_own_grasps(table: Map) -> None:
    """On top of the cup that holds them, both would rest: below them is the table."""
    heavy = trimesh.creation.box((0.2, 0.14, 0.012))
    table.add_object("slate", type="laptop", mesh=heavy, pose=(1.64, 1.7, 0.7565))
    counts = {}
    for name in ("tablet", "slate"):
        assert len(table.grasps(name, gripper="suction")) > 0
        table.connection.execute(
            "UPDATE entity SET properties = properties || '{\"mass\": 7}' WHERE name = %s", (name,)
        )
        counts[name] = table.grasps(name, gripper="suction").problems[1]
    both = table.grasps("laptop", gripper="suction").problems
    assert len(counts) == 2
    assert set(counts.values()) <= set(both)


@pytest.mark.parametrize("mass", ['"2 kg"', "-1", "true", '"NaN"', "0"])
def test_a_mass_that_is_no_number_is_refused_by_name(table: Map, mass: str) -> None:
    here = table.connection
    for name in ("mass", "weight"):
        here.execute(
            "UPDATE entity SET properties = jsonb_build_object(%s::text, %s::jsonb) "
            "WHERE name = 'tablet'",
            (name, mass),
        )
        why = f"tablet: its property {name} is .*: give kilograms, a number above 0"
        with pytest.raises(ManipulationError, match=why):
            table.grasps("tablet", gripper="suction")
        with pytest.raises(ManipulationError, match=why):
            practise(seen_by(here), "tablet", "suction")
        here.execute("SELECT 1")


def test_fingers_ask_for_no_mass(table: Map) -> None:
    table.database.add_gripper(urdf("panda"), "panda")
    table.connection.execute(
        "UPDATE entity SET properties = jsonb_build_object('mass', '2 kg') WHERE name = 'cup1'"
    )
    assert len(table.grasps("cup1", gripper="panda")) > 0


def test_the_weight_counts_before_the_mass(table: Map) -> None:
    table.connection.execute(
        "UPDATE entity SET properties = '{\"mass\": 0.1, \"weight\": 7}' WHERE name = 'tablet'"
    )
    assert "is too heavy" in table.grasps("tablet", gripper="suction").problems[-1]


def test_a_thing_without_a_pose_is_not_judged_by_weight(table: Map) -> None:
    plate = trimesh.creation.box((0.2, 0.14, 0.012))
    table.add_object("lost", type="laptop", mesh=plate)
    found = table.grasps("lost", gripper="suction", check=False)
    assert len(found) > 0
    assert found.problems == ["lost: not judged by weight: it has no pose in the map"]


def test_what_lets_air_through_and_what_is_small_is_refused(table: Map) -> None:
    bear = trimesh.creation.box((0.1, 0.1, 0.1))
    table.add_object("bear", type="teddy_bear", mesh=bear, pose=(1.4, 1.4, 0.8005))
    found = table.grasps("bear", gripper="suction")
    assert list(found) == []
    assert found.problems == [
        "bear: the ontology excludes a grasp of it by a suction gripper: air passes what is woven, "
        "soft or leafy, so a suction cup does not hold it"
    ]
    table.add_object("die", mesh=trimesh.creation.box((0.02,) * 3), pose=(1.3, 1.3, 0.7605))
    (problem,) = table.grasps("die", gripper="suction").problems
    assert problem.startswith("die: the suction cup suction of 0.03 m is tight nowhere on its")
    (problem,) = table.pushes("tablet", gripper="suction").problems
    assert (
        problem == "tablet: gripper suction is a suction cup, whose soft lip pushes nothing along"
    )


def test_a_hand_whose_palm_is_named_as_a_cup_stays_a_hand(table: Map, tmp_path: Path) -> None:
    path = tmp_path / "hand.urdf"
    path.write_text(BY_HAND.replace("palm", "vacuum_palm"))
    table.database.add_gripper(path, "plates")
    kept = stored_gripper(table.connection, "plates")
    assert (kept.kind, kept.palm, kept.cup) == ("parallel", "vacuum_palm", None)


def test_a_thing_is_put_down_by_the_cup_that_holds_it(table: Map) -> None:
    places = table.places("tablet", on="table", gripper="suction", limit=3)
    assert len(places) > 0
    for row in places:
        assert row["pose"].matrix[:3, 2] == pytest.approx([0, 0, -1], abs=1e-6)
        assert row["width"] is None
    grasp = table.connection.execute(
        "SELECT kind, width FROM action WHERE id = %s", (places[0]["grasp_id"],)
    ).fetchone()
    assert grasp == ("grasp", None)


def test_grasps_and_places_are_tried_and_outcomes_are_kept(table: Map) -> None:
    seen = seen_by(table.connection)
    tried = practise(seen, "tablet", "suction", mass=0.4)
    assert [each["outcome"] for each in tried] == ["completed"]
    assert object_model_id(table.connection, "tablet") > 0
    best = table.grasps("tablet", gripper="suction")[0]
    assert (best["action_id"], best["attempts"]) == (tried[0]["action_id"], 0.5)
    placed = practise_places(seen, "tablet", "table", "suction", mass=0.4)
    assert placed[-1]["outcome"] == "completed"


def test_plans_judge_a_cup_that_is_not_stored(table: Map) -> None:
    hand = stored_gripper(table.connection, "suction")
    rows = known_grasps(seen_by(table.connection), "tablet", "other", hand)
    assert len(rows) > 20
    assert {row["width"] for row in rows} == {None}


def test_a_thing_in_a_cloud_is_held_by_its_flat_top(table: Map) -> None:
    board = trimesh.creation.box((0.8, 0.6, 0.02))
    board.apply_translation((0, 0, -0.01))
    box = trimesh.creation.box((0.14, 0.1, 0.08))
    box.apply_translation((0.1, 0, 0.04))
    parts = ((board, 20_000), (box, 8_000))
    points = np.concatenate([trimesh.sample.sample_surface(m, n, seed=1)[0] for m, n in parts])
    points = points[points[:, 2] > -0.003]
    points = points + np.random.default_rng(0).normal(0, 3e-4, points.shape)
    found = table.database.grasps_in_cloud(points, (0.1, 0, 0.08), gripper="suction")
    assert found.problems == []
    best = found[0]["pose"].matrix
    assert best[:3, 2] == pytest.approx([0, 0, -1], abs=0.09)
    assert best[:3, 3] == pytest.approx([0.1, 0, 0.08], abs=0.02)
    for row in found:
        at, towards = row["pose"].matrix[:3, 3], row["pose"].matrix[:3, 2]
        off = np.abs(at - (0.1, 0, 0.04)) - (0.07, 0.05, 0.04)
        assert abs(off.max()) < 3e-3, "on a face of the box"
        across = np.argmax(off)
        assert abs(towards[across]) > 0.99
        others = np.delete(off, across)
        assert (others < -0.015 + 3e-3).all(), "all of the lip is on it"


def test_a_shape_alone_is_held(table: Map) -> None:
    found = table.database.grasps_of_shape("cuboid", (0.2, 0.1, 0.02), gripper="suction", limit=4)
    assert len(found) == 4
    small = table.database.grasps_of_shape("sphere", (0.01,), gripper="suction")
    assert small.problems[0].startswith("sphere of 0.01 m: the suction cup suction of 0.03 m is")


def test_an_arm_takes_and_puts_down_with_a_cup(table: Map) -> None:
    """A UR5 on a plinth before the table, with a cup on its flange."""
    db, base = table.database, (1.2, 0.8, 1.57, 0.6)
    up = {"shoulder_lift_joint": -1.57}
    db.add_manipulator(urdf("ur5"), "ur5", palm="tool0", suction=0.02, force=50, posture=up)
    (hand,) = [each for each in db.list_grippers() if each["name"] == "ur5_gripper"]
    assert (hand["form"], hand["opening"], hand["force"]) == ("suction", 0.04, 50)
    found = table.grasps("cup1", robot="ur5", base=base, plan=True)
    assert found.problems == []
    assert found.motion is not None
    assert len(found.motion.back) > 0, "with the cup as a part of the robot"
    arm = stored_arm(table.connection, "ur5")[1]
    root = Pose.planar(*base[:3], z=base[3]).matrix
    reached = root @ arm.grasp_pose(found.motion.approach[-1])
    assert reached == pytest.approx(found.motion.row["pose"].matrix, abs=6e-3)
    placed = table.places("cup1", on="table", robot="ur5", base=base, plan=True)
    assert placed.problems == []
    assert placed.motion is not None
    assert len(placed.motion.after) > 0, "the way back without it"


def test_a_cup_is_added_and_asked_by_commands(make_database: MakeDatabase, tmp_path: Path) -> None:
    url = make_database().render_as_string(hide_password=False)
    path = tmp_path / "one_cup.urdf"
    path.write_text(SUCTION)
    with package.connect(url) as db:
        desk = db.create_map("desk")
        desk.add_object("desk", type="table", size=(1, 1, 0.7), pose=(0, 0, 0))
        book = trimesh.creation.box((0.2, 0.15, 0.03))
        desk.add_object("book", type="book", mesh=book, pose=(0, 0, 0.7155))
    words = ("manipulation", "add-gripper", path, "--name", "cup", "--suction", "0.015")
    assert semmap(url, *words, "--force", "60").exit_code == 0
    (row,) = json.loads(semmap(url, "manipulation", "grippers", "--json").stdout)
    assert (row["form"], row["opening"], row["force"]) == ("suction", 0.03, 60)
    told = semmap(url, "grasp", "book", "--gripper", "cup", "--map", "desk")
    assert told.exit_code == 0
    assert "top" in told.stdout
    tried = semmap(
        url, "manipulation", "try", "book", "--gripper", "cup", "--map", "desk", "--json"
    )
    assert json.loads(tried.stdout)[-1]["outcome"] == "completed"
