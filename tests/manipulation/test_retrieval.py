"""Retrieval before generation: shapes of meshes, candidates, what is free, and the commands."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import semmap as package
from semmap import Map
from semmap.geometry.pose import Pose
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.evaluation import group_of
from semmap.manipulation.reader import actions_by_shape, actions_on, list_grippers, read_shape
from semmap.manipulation.retrieval import (
    DEFAULT_GRIPPER,
    find_grasps,
    generate,
    register_gripper,
    stored_gripper,
)
from semmap.manipulation.store.model_shapes import model_mesh, shape_of, store_shapes
from semmap.manipulation.store.models import object_model_id
from semmap.manipulation.store.tasks import add_task, record_task
from semmap.manipulation.surroundings import entity_triangles
from tests.command_line import semmap
from tests.conftest import MakeDatabase
from tests.manipulation.grippers import BY_HAND
from tests.manipulation.test_collision import hulls_meet
from tests.seen import seen_by


def test_the_shapes_of_all_meshes_are_found_once(house: Map) -> None:
    here = house.connection
    house.add_object(
        "flat",
        type="paper",
        define=True,
        mesh=trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
        pose=(0, 0, 0),
    )
    found = store_shapes(seen_by(here))
    rows, problems = found.rows, found.problems
    assert {row["entity"]: row["shape"] for row in rows} == {
        "table": "cuboid",
        "Vase_01": "cylinder",
        "SeasoningBox_01": "cuboid",
        "Ball_01": "sphere",
    }
    assert problems == ["flat: the mesh is flat, it has no volume: give the mesh of a solid"]
    ball = read_shape(here, object_model_id(here, "Ball_01"))
    mesh = model_mesh(seen_by(here), "Ball_01")
    assert ball is not None
    assert ball["size"] == pytest.approx([mesh.extents.mean() / 2], rel=0.03)
    assert shape_of(seen_by(here), "Ball_01").pose[:3, 3] == pytest.approx(
        mesh.bounds.mean(axis=0), abs=0.01
    )


def test_generated_grasps_are_stored_and_free_of_the_table(house: Map) -> None:
    here = house.connection
    first = find_grasps(seen_by(here), name="vase", limit=40)
    assert first.generated == ["Vase_01"]
    assert [g["name"] for g in list_grippers(here)] == ["parallel_gripper"]
    again = find_grasps(seen_by(here), name="Vase_01", limit=40)
    assert again.generated == []
    assert [r["action_id"] for r in again.rows] == [r["action_id"] for r in first.rows]
    assert first.rows
    everywhere = find_grasps(seen_by(here), name="vase", limit=1000, check=False).rows
    assert len(everywhere) > len(first.rows)
    fingers = np.array([[x, 0, 0.0] for x in (-0.02, 0.02)])  # the middle of the pads
    assert min(row["pose"].apply(fingers)[:, 2].min() for row in first.rows) > 0.75


def test_stored_grasps_by_instance_type_function_pose_and_shape_the_best_first(
    house: Map,
) -> None:
    """Two meshes of small_house with random outcomes, beside a sort of all rows in Python."""
    here = house.connection
    random = np.random.default_rng(7)
    names = {}
    for name in ("Vase_01", "SeasoningBox_01"):
        ids = generate(seen_by(here), name)
        names[object_model_id(here, name)] = name
        for id_ in random.choice(ids, 25):
            outcome = str(random.choice(["completed", "error"]))
            record_task(here, name, action=int(id_), outcome=outcome)
        failed, worked = (int(v) for v in random.choice(ids, 2, replace=False))
        record_task(here, name, action=worked, outcome="completed", instead_of=failed)

    def best(*wanted: str) -> list[int]:
        rows = here.execute(
            "SELECT id, object_id, attempts, successes, quality FROM action "
            "WHERE kind = 'grasp' AND replaced_by IS NULL"
        )
        share = {
            id_: (successes + 2 * quality) / (attempts + 2)
            for id_, object_, attempts, successes, quality in rows
            if names[object_] in wanted
        }
        return sorted(share, key=lambda id_: (-share[id_], id_))[:40]

    def found(**asked: Any) -> list[int]:
        return [row["action_id"] for row in actions_on(seen_by(here), **asked, limit=40)]

    vase, box = "Vase_01", "SeasoningBox_01"
    assert found(name=vase) == found(name="vase") == best(vase)
    assert found(name=box) == found(name="kitchenware") == best(box)
    assert found(name="container") == best(vase, box)
    assert found(function="storing") == best(vase, box)
    assert found(function="seasoning") == best(box)
    inside = entity_triangles(seen_by(here), vase).reshape(-1, 3).mean(axis=0)
    assert found(point=inside) == best(vase)
    low, high = (
        entity_triangles(seen_by(here), box).min(axis=(0, 1)),
        entity_triangles(seen_by(here), box).max((0, 1)),
    )
    beside = [high[0] + 0.02, *((low + high) / 2)[1:]]
    assert found(point=beside, tolerance=0.03) == best(box)
    with pytest.raises(LookupError, match="no object with geometry within"):
        found(point=beside, tolerance=0.01)
    shape = shape_of(seen_by(here), vase)
    size = np.add(shape.size, 0.004)
    alike = actions_by_shape(here, shape.kind, size, tolerance=0.005, limit=40)
    assert [row["action_id"] for row in alike] == best(vase)
    assert actions_by_shape(here, shape.kind, size, tolerance=0.003) == []
    for row, own in zip(alike, actions_on(seen_by(here), name=vase, limit=40), strict=True):
        placed = shape.pose @ row["pose"].matrix
        np.testing.assert_allclose(placed, own["model_pose"].matrix, atol=1e-6)


def test_the_open_gripper_must_not_touch_the_object_unless_the_grasp_has_succeeded(
    house: Map,
) -> None:
    """Beside linear programs over the links of the gripper and the faces of a box in the air."""
    here = house.connection
    house.add_object("bar", type="bar", define=True, size=(0.05, 0.05, 0.16), pose=(3.4, 0.5, 1.4))
    free = {row["action_id"] for row in find_grasps(seen_by(here), name="bar", limit=400).rows}
    every = find_grasps(seen_by(here), name="bar", limit=400, check=False).rows
    touching = [row for row in every if row["action_id"] not in free]
    assert len(free) > 50
    assert len(touching) > 20
    gripper = stored_gripper(here, "parallel_gripper")
    faces = entity_triangles(seen_by(here), "bar")
    random = np.random.default_rng(0)
    for row in random.choice(np.array(every), 12, replace=False):
        ends = [row[name].matrix for name in ("pose", "pre_pose")]
        touches = False
        for number, link in enumerate(gripper.links):
            corners = gripper.robot.hull(link)
            moved = [end @ gripper.poses[0, number] for end in ends]
            passed = np.concatenate([corners @ m[:3, :3].T + m[:3, 3] for m in moved])
            touches |= any(hulls_meet(passed, face) for face in faces)
        assert touches == (row["action_id"] not in free)
    add_task(here, "bar", action=touching[0]["action_id"], outcome="completed")
    again = {row["action_id"] for row in find_grasps(seen_by(here), name="bar", limit=400).rows}
    assert again == free | {touching[0]["action_id"]}


def test_what_does_not_fit_is_said_with_its_size(house: Map) -> None:
    found = find_grasps(seen_by(house.connection), name="ball")
    assert found.rows == []
    assert found.problems[0].startswith("Ball_01: no grasp fits its shape (sphere 0.3")
    assert found.problems[0].endswith("gripper parallel_gripper opens 0.09 m")


def test_an_object_among_others_has_no_free_grasp(house: Map) -> None:
    here = house.connection
    middle = model_mesh(seen_by(here), "SeasoningBox_01").bounds.mean(axis=0)
    house.add_object(
        "box", type="box", size=(0.08, 0.32, 0.1), pose=(1.4 + middle[0], 1.0 + middle[1], 0.751)
    )
    found = find_grasps(seen_by(here), name="SeasoningBox_01")
    assert found.rows == []
    assert "the gripper touches what is around" in found.problems[-1]
    assert find_grasps(seen_by(here), name="SeasoningBox_01", check=False).rows


def test_outcomes_on_a_shape_rank_the_grasps_of_a_similar_one(cups: Map) -> None:
    here = cups.connection
    register_gripper(here, DEFAULT_GRIPPER)
    best = find_grasps(seen_by(here), name="cup1", gripper="parallel_gripper", check=False).rows[0]
    mesh = trimesh.creation.cylinder(0.036, 0.1, sections=32)
    cups.add_object("beaker", type="mug", mesh=mesh, pose=(1.5, 1.3, 0.8))
    before = _ranks(here, "beaker", "parallel_gripper")
    for _ in range(4):
        record_task(here, "cup1", action=best["action_id"], outcome="error")
    own = _ranks(here, "beaker", "parallel_gripper")  # what it had before is ranked again
    assert own.keys() == before.keys()
    assert own[best["family"]] == min(own.values())
    assert own[best["family"]] < 0.75 * max(own.values())


def test_a_second_gripper_profits_from_the_first_ones_outcomes(cups: Map, tmp_path: Path) -> None:
    here = cups.connection
    register_gripper(here, DEFAULT_GRIPPER)
    (tmp_path / "plates.urdf").write_text(BY_HAND)
    register_gripper(here, tmp_path / "plates.urdf", "plates")
    untaught = _ranks(here, "cup1", "plates")
    best = find_grasps(seen_by(here), name="cup1", gripper="parallel_gripper", check=False).rows[0]
    for _ in range(6):
        record_task(here, "cup1", action=best["action_id"], outcome="error")
    taught = _ranks(here, "cup1", "plates")
    assert best["family"] in untaught
    assert taught.keys() == untaught.keys()
    group = group_of(best["family"])
    alike = [share for family, share in taught.items() if group_of(family) == group]
    others = [share for family, share in taught.items() if group_of(family) != group]
    # Six failures on the object count half for the group; the prior counts half a trial.
    assert max(alike) < min(others) / 4
    assert max(others) < max(untaught.values()) / 2  # grasps of other families are like them, too


def _ranks(here: Any, name: str, gripper: str) -> dict[str, float]:
    """The expected share of successes of the best grasp of each family."""
    rows = find_grasps(seen_by(here), name=name, gripper=gripper, limit=1000, check=False).rows
    return {row["family"]: row["expected"] for row in reversed(rows)}


def test_a_gripper_without_fingers_or_without_its_file_is_refused(
    cups: Map, tmp_path: Path
) -> None:
    here = cups.connection
    stick = tmp_path / "stick.urdf"
    stick.write_text(
        '<robot name="stick"><link name="a"><collision><geometry><box size="1 1 1"/></geometry>'
        "</collision></link></robot>"
    )
    with pytest.raises(ManipulationError, match=r"stick\.urdf: no link has two fingers"):
        register_gripper(here, stick)
    assert "stick" not in [g["name"] for g in list_grippers(here)]
    shutil.copy(DEFAULT_GRIPPER, stick)
    assert register_gripper(here, stick, "mine") == "mine"
    assert stored_gripper(here, "mine").opening == pytest.approx(0.09)
    stick.unlink()
    with pytest.raises(ManipulationError, match="is not there"):
        stored_gripper(here, "mine")
    with pytest.raises(ManipulationError, match="its URDF is not stored"):
        generate(seen_by(here), "cup1", "wide")


# -- commands -------------------------------------------------------------------------------------


@pytest.fixture
def url(make_database: MakeDatabase) -> str:
    url = make_database().render_as_string(hide_password=False)
    with package.connect(url) as db:
        made = db.create_map("flat")
        made.add_room("room", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.7)
        made.add_object("table", type="table", size=(1.6, 0.8, 0.75), pose=(1.5, 1.5, 0))
        made.add_object("mug", type="mug", size=(0.07, 0.07, 0.1), pose=(1.5, 1.5, 0.75))
    return url


def test_the_commands_from_a_query_to_a_shared_outcome(url: str, tmp_path: Path) -> None:
    told = semmap(url, "grasp", "--for", "drink", "--json")
    rows = json.loads(told.stdout)
    assert (told.exit_code, {row["entity"] for row in rows}) == (0, {"mug"})
    assert Pose(*rows[0]["pose"]).z > 0.75
    first = rows[0]["action_id"]
    assert semmap(url, "manipulation", "record", "mug", first, "error").exit_code == 0
    assert json.loads(semmap(url, "grasp", "mug", "--json").stdout)[0]["action_id"] != first
    assert "error" in semmap(url, "manipulation", "tasks").stdout
    bundle = tmp_path / "mug.bundle"
    assert "actions" in semmap(url, "manipulation", "export", bundle, "--name", "me").stdout
    public = semmap(url, "manipulation", "key").stdout.strip()
    assert len(public) == 64
    with pytest.raises(ManipulationError, match="whom nobody trusts"):
        semmap(url, "manipulation", "import", bundle)
    semmap(url, "manipulation", "trust", "myself", public, "--level", "0.5")
    assert "0 actions, 1 outcomes" in semmap(url, "manipulation", "import", bundle).stdout
    assert "myself" in semmap(url, "manipulation", "contributors").stdout
    (default,) = json.loads(semmap(url, "manipulation", "grippers", "--json").stdout)
    assert not default["preferred"]  # the next one that is added is
    assert "cuboid" in semmap(url, "manipulation", "shapes").stdout
    at = semmap(url, "grasp", "--at", "1.5,1.5,0.8", "--stored", "--limit", "1")
    assert "mug" in at.stdout
    places = json.loads(semmap(url, "place", "mug", "--on", "table", "--json").stdout)
    assert {(row["entity"], row["on"]) for row in places} == {("mug", "table")}
    assert all(0.75 < row["spot"][2] < 0.76 for row in places)
    assert "mug" in semmap(url, "grasp", "mug", "--kind", "place").stdout
    pushes = json.loads(semmap(url, "push", "mug", "--limit", 16, "--json").stdout)
    assert len(pushes) == 16
    assert "180" in semmap(url, "push", "mug", "--distance", 0.2, "--limit", 16).stdout
    shape = semmap(url, "grasp", "--shape", "cuboid=0.07,0.07,0.1", "--json")
    assert len(json.loads(shape.stdout)) == 10


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["muug"], "did you mean mug"),
        (["--for", "flying"], "no type and no object model has the function flying"),
        (["--at", "0.1,0.1,2"], "no object with geometry within"),
        (["mug", "--gripper", "pr2"], "no gripper pr2"),
        (["--shape", "cylinder=0.1"], "is not a shape"),
        (["mug", "--kind", "kick"], "kick is not one of"),
    ],
)
def test_questions_that_cannot_be_answered(url: str, words: list[str], text: str) -> None:
    with pytest.raises((LookupError, ManipulationError), match=text):
        semmap(url, "grasp", *words)


def test_no_answer_is_an_exit_status(url: str) -> None:
    assert semmap(url, "grasp", "bottle").exit_code == 1
    assert semmap(url, "grasp", "table").exit_code == 1
    assert semmap(url, "grasp", "mug", "--kind", "push").exit_code == 1
    assert semmap(url, "grasp").exit_code == 2
    with pytest.raises(ManipulationError, match="mug: has no level surface"):
        semmap(url, "place", "table", "--on", "mug")
    with pytest.raises(ValueError, match="--towards X,Y takes 2 numbers"):
        semmap(url, "place", "mug", "--on", "table", "--towards", "1")


CHANGES_OF_MESHES = (
    "INSERT INTO object_model (key) VALUES ('other')",
    "DELETE FROM object_mesh WHERE digest IN (SELECT digest FROM object_mesh ORDER BY 1 LIMIT 1)",
    "UPDATE object_mesh SET object_id = (SELECT max(id) FROM object_model)",
    "INSERT INTO object_mesh (digest, object_id) SELECT digest, (SELECT min(id) FROM object_model) "
    "FROM model ON CONFLICT DO NOTHING",
    "UPDATE entity_model SET model_id = (SELECT min(model_id) FROM entity_model) "
    "WHERE entity_id = (SELECT max(entity_id) FROM entity_model)",
    "DELETE FROM entity WHERE id = (SELECT max(entity_id) FROM entity_model)",
    "DELETE FROM object_model WHERE id = (SELECT max(id) FROM object_model)",
)
"""What changes the object model of entities."""


def test_object_models_of_entities_follow_their_meshes(house: Map) -> None:
    by_meshes = (
        "SELECT DISTINCT ON (em.entity_id) em.entity_id, h.object_id FROM entity_model em "
        "JOIN model m ON m.id = em.model_id JOIN object_mesh h ON h.digest = m.digest "
        "ORDER BY em.entity_id, em.role DESC, h.object_id"
    )
    store_shapes(seen_by(house.connection))
    seen = set()
    for change in ("SELECT", *CHANGES_OF_MESHES):
        house.execute(change)
        kept = house.execute("SELECT entity_id, object_id FROM entity_object ORDER BY 1")
        assert kept == house.execute(by_meshes), change
        seen.add(str(kept))
    assert len(seen) > 4
