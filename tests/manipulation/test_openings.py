"""Openings and turns of random cabinets in a map; yourdfpy, trimesh and MuJoCo judge them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
import trimesh
import yourdfpy
from numpy.typing import NDArray

import semmap
from semmap import Database, Map
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from tests.conftest import MakeDatabase
from tests.effort import effort
from tests.manipulation.cabinets import Cabinet
from tests.manipulation.grippers import SUCTION, real_gripper, urdf

Imported = Callable[[Cabinet], Map]

DOOR = Cabinet("door", "bar", 0.4, 0.5, 0.3, 0.02, 1, 1.4, 0.045, 0.007, 0.14)


@pytest.fixture(scope="module")
def db(make_database: MakeDatabase) -> Iterator[Database]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        db.add_gripper(urdf("panda"), "panda")
        db.add_gripper(urdf("pr2"), "pr2")
        yield db


@pytest.fixture
def imported(db: Database, tmp_path: Path) -> Imported:
    def made(cabinet: Cabinet) -> Map:
        name = f"map {len(db.maps)}"
        db.import_file(cabinet.write(tmp_path / "cabinet.urdf"), map=name)
        return db.map(name)

    return made


@pytest.fixture
def door(imported: Imported) -> Map:
    return imported(DOOR)


def part_poses(folder: Path, cabinet: Cabinet, *positions: float) -> list[NDArray[np.float64]]:
    """Where the part is in the frame of the cabinet at positions of its joint, by yourdfpy."""
    robot = yourdfpy.URDF.load(str(folder / "cabinet.urdf"), load_meshes=False)
    found = []
    for position in positions:
        robot.update_cfg({"moves": float(position)})
        found.append(np.array(robot.get_transform(cabinet.kind, "cabinet")))
    return found


def move(house: Map, name: str, pose: NDArray[np.float64]) -> None:
    """Move a part to a pose that is turned about the vertical."""
    house[name].move_to(*pose[:3, 3].tolist(), yaw=math.atan2(pose[1, 0], pose[0, 0]))


@pytest.mark.explore
@pytest.mark.parametrize("seed", effort([1, 2], range(8)))
def test_the_gripper_takes_the_handle_and_keeps_to_it(
    imported: Imported, tmp_path: Path, seed: int
) -> None:
    cabinet = Cabinet.random(seed)
    robot = ("panda", "pr2")[seed % 2]
    house = imported(cabinet)
    asked = "handle" if cabinet.apart else cabinet.kind
    found = house.openings(asked, gripper=robot, limit=30)
    assert found.generated == [cabinet.kind]
    assert len(found) == 30
    closed, opened = part_poses(tmp_path, cabinet, 0, cabinet.travel)
    hand = real_gripper(robot)
    reach = cabinet.length / 2 + cabinet.radius if cabinet.form == "bar" else cabinet.off
    for row in found:
        assert row["travel"] == pytest.approx(cabinet.travel, abs=1e-4)
        assert len(row["motion"]) == (7 if cabinet.kind == "door" else 3)
        before = np.linalg.inv(closed) @ row["pose"].matrix
        for key, at in (("end", row["pose"]), ("post_pose", row["pre_pose"])):
            after = np.linalg.inv(opened) @ row[key].matrix
            assert np.allclose(np.linalg.inv(closed) @ at.matrix, after, atol=2e-5)
        pads = before[:3, :3] @ hand.pads_at(np.array([row["width"]]))[0] + before[:3, 3]
        assert np.linalg.norm(pads - cabinet.handle_at) < reach + 0.01
        assert row["width"] < hand.opening
    again = house.openings(cabinet.kind, gripper=robot, limit=30)
    assert not again.generated
    assert [row["action_id"] for row in again] == [row["action_id"] for row in found]


def test_the_hand_does_not_touch_the_body_on_its_way(imported: Imported, tmp_path: Path) -> None:
    """The open and closed fingers as trimesh meshes against the body's boxes."""
    house = imported(DOOR)
    hand = real_gripper("panda")
    body = trimesh.collision.CollisionManager()
    model = yourdfpy.URDF.load(str(tmp_path / "cabinet.urdf"))
    for name, shape in model.scene.geometry.items():
        if model.scene.graph.transforms.parents[name] == "cabinet":
            body.add_object(name, shape, model.scene.graph.get(name)[0])
    for row in house.openings("door", gripper="panda", limit=5):
        for turn in np.linspace(0, DOOR.travel, 8):
            closed, at = part_poses(tmp_path, DOOR, 0, turn)
            pose = at @ np.linalg.inv(closed) @ row["pose"].matrix
            for link, mesh in hand.meshes(row["width"]).items():
                hull = trimesh.Trimesh(mesh.vertices, mesh.faces).convex_hull
                assert not body.in_collision_single(hull, pose), link


@pytest.mark.parametrize("seed", [1, 5])
def test_practice_stores_how_openings_end(imported: Imported, seed: int) -> None:
    cabinet = Cabinet.random(seed)
    house = imported(cabinet)
    tried = house.practise(cabinet.kind, open_=True, gripper="panda")
    assert tried[-1]["outcome"] == "completed"
    assert tried[-1]["opened"] > 0.9
    task = house.list_manipulations(1)[0]
    assert (task["kind"], task["entity"], task["outcome"]) == ("open", cabinet.kind, "completed")
    assert (task["action_id"], task["contributor"]) == (tried[-1]["action_id"], "simulation")
    (best,) = house.openings(cabinet.kind, gripper="panda", limit=1)
    assert best["action_id"] == tried[-1]["action_id"]
    assert best["successes"] > 0
    slippery = house.practise(
        cabinet.kind, open_=True, gripper="panda", tries=2, friction=0.02, mass=40
    )
    assert {each["outcome"] for each in slippery} <= {"let go", "stuck", "missed"}


def test_an_open_door_is_pushed_to_and_not_opened_again(door: Map, tmp_path: Path) -> None:
    closed, ajar, opened = part_poses(tmp_path, DOOR, 0, 0.5, DOOR.travel)
    found = door.turns("door", gripper="panda")
    assert "the gripper touches what is around" in found.problems[0]  # its back is in the cabinet
    move(door, "door", opened)
    with pytest.raises(ValueError, match=r"is open already: its joint goes from 0 to 1\.4"):
        door.openings("door", gripper="panda")
    found = door.turns("door", gripper="panda")
    assert found.rows
    for row in found:
        assert row["travel"] == pytest.approx(-DOOR.travel, abs=1e-4)
        hand = np.linalg.inv(opened) @ row["pose"].matrix
        assert np.allclose(hand, np.linalg.inv(closed) @ row["end"].matrix, atol=2e-5)
        assert np.allclose(row["pre_pose"].rotation_matrix, row["pose"].rotation_matrix)
    tried = door.practise("door", turn=True, gripper="panda")
    assert tried[-1]["outcome"] == "completed"
    assert door.list_manipulations(1)[0]["kind"] == "turn"
    move(door, "door", ajar)
    (row,) = door.openings("door", gripper="panda", limit=1)
    assert row["travel"] == pytest.approx(DOOR.travel - 0.5, abs=1e-3)
    (row,) = door.openings("door", gripper="panda", limit=1, travel=0.3)
    assert row["travel"] == pytest.approx(0.3)
    with pytest.raises(ValueError, match=r"is at 0\.5: travel 1 is too far"):
        door.openings("door", gripper="panda", travel=1)
    move(door, "door", Pose(x=1).matrix @ ajar)
    with pytest.raises(ValueError, match="was moved away from its joint"):
        door.openings("door", gripper="panda")


def test_a_stated_axis_is_that_of_the_map(door: Map) -> None:
    """A leaf whose joint nobody knows; trimesh turns the hand about the axis that is stated."""
    leaf = door.add_object("leaf", mesh=door["door"].mesh, pose=(3, 1, 0, 0.7))
    with pytest.raises(ValueError, match="the map does not know how it moves: give hinge="):
        leaf.map.openings("leaf", gripper="pr2")
    with pytest.raises(ValueError, match="travel is missing"):
        door.openings("leaf", hinge=(3, 1, 0, 0, 0, 1), gripper="pr2")
    found = door.openings("leaf", hinge=(3, 1, 5, 0, 0, -2), travel=DOOR.travel, gripper="panda")
    assert found.rows
    for row in found:
        turn = trimesh.transformations.rotation_matrix(DOOR.travel, (0, 0, -1), (3, 1, 0))
        assert np.allclose(turn @ row["pose"].matrix, row["end"].matrix, atol=1e-6)
    without = door.openings("leaf", gripper="panda", limit=5)  # stored ones tell how it moves
    assert [row["action_id"] for row in without] == [row["action_id"] for row in found[:5]]
    about: dict[str, Any] = {"hinge": (3, 1, 0, 0, 0, 1), "travel": -DOOR.travel}
    other = door.openings("leaf", gripper="panda", limit=5, **about)
    assert [row["action_id"] for row in other] == [row["action_id"] for row in found[:5]]
    assert [row["travel"] for row in found[:5]] == pytest.approx([DOOR.travel] * 5)
    assert [row["travel"] for row in other] == pytest.approx([-DOOR.travel] * 5)


def test_the_sign_of_a_travel_is_that_along_the_slide(door: Map) -> None:
    """A leaf that slides off; on its side, another one, of which the bar lies level."""
    shape = door["door"].mesh
    door.add_object("leaf", mesh=shape, pose=(3, 1, 0, 0))
    found = door.openings("leaf", slide=(2, 0, 0), travel=-0.3, gripper="panda", limit=5)
    assert found.rows
    for row in found:
        assert row["travel"] == pytest.approx(-0.3)
        assert row["end"].x - row["pose"].x == pytest.approx(-0.3)
    again = door.openings("leaf", slide=(-1, 0, 0), travel=0.3, gripper="panda", limit=5)
    assert [row["action_id"] for row in again] == [row["action_id"] for row in found]
    assert [row["travel"] for row in again] == pytest.approx([0.3] * 5)
    along = door.openings("leaf", travel=0.3, gripper="panda", limit=5)
    assert [row["action_id"] for row in along] == [row["action_id"] for row in found]
    with pytest.raises(ValueError, match=r"travel is -0\.3, .* no direction in which it slides: "):
        door.openings("leaf", travel=-0.3, gripper="panda")

    flap = door.add_object("flap", mesh=shape, pose=(5, 1, 2))
    door.connection.execute(
        "UPDATE placement SET pose[4:7] = %s::float8[] WHERE entity_id = entity_id(%s)",
        ([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)], flap.name),
    )
    for name, travel in (("leaf", 0.25), ("flap", 0.2)):
        ways = door.openings(name, slide=(-1, 0, 0), travel=travel, gripper="panda", limit=20)
        closing = np.array([row["pose"].rotation_matrix[2, 0] for row in ways])
        words = [row["family"].split()[-1] for row in ways]
        assert {"across", "along"} & {*words}
        for up, word in zip(np.abs(closing), words, strict=True):
            assert word == "out" or (word == "along") == (up > 0.7)


def test_what_is_in_the_way_is_named(door: Map) -> None:
    door.add_object("bin", size=(0.2, 0.2, 0.6), pose=(-0.5, 0, 0))
    found = door.openings("door", gripper="panda")
    assert not found.rows
    assert "door: meets bin after" in found.problems[0]
    share = float(found.problems[0].split("after ")[1].split("%")[0]) / 100
    some = door.openings("door", gripper="panda", travel=0.8 * share * DOOR.travel)
    assert not any("meets" in problem for problem in some.problems)


def test_what_holds_the_body_is_in_the_way(door: Map) -> None:
    """A counter with a post before the cabinet that stands on it."""
    boxes = [
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
        for size, at in (((2, 2, 0.1), (0, 0, -0.05)), ((0.2, 0.2, 0.6), (-0.5, 0, 0.3)))
    ]
    both: Any = trimesh.util.concatenate(boxes)
    counter = Mesh(np.asarray(both.vertices), np.asarray(both.faces, np.int32))
    door.add_object("counter", mesh=counter, pose=(0, 0, 0))
    door["cabinet"].move_to(0, 0, 0)
    holder = door["cabinet"].holder
    assert holder is not None
    assert holder.name == "counter"
    (problem,) = door.openings("door", gripper="panda").problems
    assert "door: meets counter after" in problem


REFUSED: dict[str, tuple[str, str, dict[str, Any], str]] = {
    "a body": (
        "openings",
        "cabinet",
        {},
        r"name a part of it that does \(door\), or",
    ),
    "both": ("openings", "door", {"hinge": (0, 0, 0, 0, 0, 1), "slide": (1, 0, 0)}, "give one of"),
    "a hinge of five": ("openings", "door", {"hinge": (0, 0, 0, 0, 1), "travel": 1}, "hinge is"),
    "no direction": ("turns", "door", {"hinge": (0,) * 6, "travel": 1}, "give a point of the axis"),
    "no travel": ("openings", "door", {"slide": (1, 0, 0)}, "travel is missing"),
    "a travel of 0": ("openings", "door", {"travel": 0}, "travel is 0: give radians"),
    "a NaN": ("openings", "door", {"travel": math.nan}, "travel is nan"),
    "too far": ("openings", "door", {"travel": 2}, "goes from 0 to 1.4 and is at .*too far"),
    "no rows": ("openings", "door", {"limit": 0}, "limit is 0"),
    "a plan": ("turns", "door", {"plan": True}, "plan: only for a robot"),
    "two hands": ("openings", "door", {"robot": "a", "gripper": "panda"}, "has its own gripper"),
    "no object": ("openings", "gate", {}, "no entity gate"),
    "two kinds": ("practise", "door", {"open_": True, "turn": True}, "give one of on, push, open_"),
    "a slide": ("turns", "drawer", {}, "a part on a slide cannot be turned"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_input_is_refused_and_changes_nothing(db: Database, case: str, tmp_path: Path) -> None:
    if "refused" not in db.maps:
        db.import_file(DOOR.write(tmp_path / "door.urdf"), map="refused")
        drawer = Cabinet.random(2, "drawer").write(tmp_path / "drawer.urdf")
        text = drawer.read_text().replace('name="cabinet"', 'name="chest"')
        drawer.write_text(text.replace('link="cabinet"', 'link="chest"'))
        db.import_file(drawer, map="refused")
    house = db.map("refused")
    method, name, options, message = REFUSED[case]
    count = "SELECT count(*) FROM action"
    before = db.session.execute(count).fetchone()
    with pytest.raises((ValueError, LookupError), match=message):
        getattr(house, method)(name, **({"gripper": "panda"} | options))
    assert db.session.execute(count).fetchone() == before


MADE = (
    "INSERT INTO object_model (key) VALUES ('mesh:of-this-test')",
    "INSERT INTO device (id, name, kind) VALUES (-1, 'of this test', 'gripper')",
    "INSERT INTO gripper (device_id, form, opening, depth) VALUES (-1, 'parallel', 0.1, 0.1)",
)
"""An object model and a gripper."""


def test_the_table_takes_slides_and_hinges_alone(db: Database) -> None:
    for count, kind in ((3, "open"), (7, "open"), (6, "open"), (3, "turn")):
        statement = (
            "INSERT INTO action (kind, object_id, gripper_id, pose, motion) SELECT %s, o.id, "
            "g.device_id, '{0,0,0,0,0,0,1}', array_fill(1.0::float8, ARRAY[%s]) "
            "FROM object_model o, gripper g LIMIT 1"
        )
        with db.session.transaction() as transaction:
            for made in MADE:
                db.session.execute(made)
            if kind == "open" and count != 6:
                assert db.session.execute(statement, (kind, count)).rowcount == 1
            else:
                with pytest.raises(psycopg.errors.CheckViolation):
                    db.session.execute(statement, (kind, count))
            raise psycopg.Rollback(transaction)


def test_a_cup_neither_opens_nor_turns(db: Database, door: Map, tmp_path: Path) -> None:
    path = tmp_path / "one_cup.urdf"
    path.write_text(SUCTION)
    db.add_gripper(path, "suction", suction=0.015)
    for asked, does in ((door.openings, "closes on no handle"), (door.turns, "about a hinge")):
        found = asked("door", gripper="suction")
        assert (list(found), found.generated) == ([], [])
        (problem,) = found.problems
        assert problem.startswith("door: gripper suction is a suction cup, whose soft lip ")
        assert does in problem
