"""Grasps of shapes and of things in clouds that no map has, judged by the meshes they are of."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import trimesh

import semmap
from semmap.manipulation.candidates import grasp_candidates
from tests.conftest import MakeDatabase
from tests.manipulation.grippers import Shape, real_gripper, urdf
from tests.manipulation.hollow_things import mug

MUG, BOX = (0.1, 0.05, 0.0), (-0.15, 0.0, 0.06)


@pytest.fixture(scope="module")
def kitchen(make_database: MakeDatabase) -> Iterator[semmap.Database]:
    """A database that has no model, and one gripper."""
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        db.add_gripper(urdf("panda"), name="panda")
        yield db


def table_with_mug_and_box(noise: float) -> tuple[np.ndarray, list[trimesh.Trimesh]]:
    """Points of a table at z = 0, a mug and a box on it, and the meshes."""
    table = trimesh.creation.box((0.8, 0.6, 0.02))
    things = [mug(), trimesh.creation.box((0.05, 0.05, 0.12))]
    for thing, place in zip((table, *things), ((0, 0, -0.01), MUG, BOX), strict=True):
        thing.apply_translation(place)
    sampled = [
        trimesh.sample.sample_surface(each, count, seed=1)[0]
        for each, count in ((table, 20_000), (things[0], 8_000), (things[1], 4_000))
    ]
    points = np.concatenate(sampled)
    points = points[points[:, 2] > -0.003]  # seen from above
    return points + np.random.default_rng(0).normal(0, noise, points.shape), [*things, table]


def test_a_shape_of_which_nothing_is_stored_is_grasped(kitchen: semmap.Database) -> None:
    found = kitchen.grasps_of_shape("cylinder", (0.03, 0.1), gripper=urdf("panda"), limit=1000)
    expected = grasp_candidates(Shape("cylinder", (0.03, 0.1)), real_gripper("panda"))
    assert len(found) == len(expected)
    for row, grasp in zip(found, expected, strict=True):
        np.testing.assert_allclose(row["pose"].matrix, grasp.pose, atol=1e-9)
        assert row["action_id"] is None
    assert found.generated == ["cylinder of 0.03 x 0.1 m"]
    nothing = kitchen.grasps_of_shape("cylinder", (0.03, 0.1), gripper="panda", stored=True)
    assert (list(nothing), nothing.generated) == ([], [])
    assert nothing.problems == ["no grasp of a similar cylinder is stored"]
    wide = kitchen.grasps_of_shape("sphere", (0.3,), gripper="panda")
    assert wide.problems == [
        "sphere of 0.3 m: no grasp fits its shape (sphere 0.3 m); gripper panda opens 0.08 m"
    ]
    assert kitchen.session.execute("SELECT count(*) FROM action").fetchone() == (0,)


def test_a_map_generates_grasps_of_a_shape_too(kitchen: semmap.Database) -> None:
    home = kitchen.create_map("home")
    assert home.grasps(shape=("cuboid", 0.04, 0.05, 0.1))
    assert not home.grasps(shape=("cuboid", 0.04, 0.05, 0.1), stored=True)


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_things_in_a_cloud_are_grasped_where_they_are(
    kitchen: semmap.Database, noise: float
) -> None:
    points, things = table_with_mug_and_box(noise)
    gripper = real_gripper("panda")
    for number, at in ((0, (0.1, 0.093, 0.08)), (1, (-0.15, 0.02, 0.12))):
        found = kitchen.grasps_in_cloud(points, at, gripper=urdf("panda"), limit=20)
        assert found.problems == []
        assert [row["expected"] for row in found] == sorted(
            (row["expected"] for row in found), reverse=True
        )
        for row in found:
            pose = row["pose"].matrix
            pads = pose[:3, 3] + pose[:3, :3] @ gripper.pads_at(np.array([row["width"]]))[0]
            _, apart, _ = trimesh.proximity.closest_point(things[number], [pads])
            assert apart[0] < row["width"] / 2 + 0.003  # in the middle of what it holds
            # Nothing of the open fingers is in the thing, the other one or the table.
            for name, mesh in gripper.meshes(gripper.opening).items():
                if any(name in finger for finger in gripper.fingers):
                    corners = mesh.used[::7] @ pose[:3, :3].T + pose[:3, 3]
                    assert corners[:, 2].min() > -0.004
                    assert not any(each.contains(corners).any() for each in things)
    assert all(0.048 < row["width"] < 0.058 for row in found)


def test_an_arm_that_cannot_tilt_its_gripper_takes_things_at_its_slant(
    kitchen: semmap.Database,
) -> None:
    points, _ = table_with_mug_and_box(0.0)
    gripper = real_gripper("stretch_arm")
    found = kitchen.grasps_in_cloud(
        points, (-0.15, 0.02, 0.12), gripper=urdf("stretch_arm"), limit=500
    )
    assert found
    assert all(gripper.can_tilt_to(row["pose"].matrix) for row in found)


def test_why_nothing_in_a_cloud_is_grasped(kitchen: semmap.Database) -> None:
    """A block too wide for the hand; and one between walls that leave no room for it."""
    table = trimesh.creation.box((0.8, 0.6, 0.02))
    table.apply_translation((0, 0, -0.01))
    block = trimesh.creation.box((0.05, 0.05, 0.1))
    block.apply_translation((0, 0, 0.05))
    wide = trimesh.creation.box((0.2, 0.2, 0.2))
    wide.apply_translation((0, 0, 0.1))
    walls = []
    for x, y in ((0.05, 0), (-0.05, 0), (0, 0.05), (0, -0.05)):
        wall = trimesh.creation.box((0.01 if x else 0.09, 0.01 if y else 0.09, 0.3))
        wall.apply_translation((x, y, 0.15))
        walls.append(wall)
    for things, why in (([wide], "no grasp fits its shape"), ([block, *walls], "touches what is")):
        every = [trimesh.sample.sample_surface(t, 12_000, seed=1)[0] for t in (table, *things)]
        points = np.concatenate(every)
        points = points[points[:, 2] > -0.003]
        at = (0, 0, 0.1 if things[0] is block else 0.2)
        found = kitchen.grasps_in_cloud(points, at, gripper=urdf("panda"))
        assert not found
        assert found.generated == []
        assert why in found.problems[0]


def test_no_object_at_a_point_of_a_cloud(kitchen: semmap.Database) -> None:
    points, _ = table_with_mug_and_box(0.0)
    with pytest.raises(LookupError, match=r"no object stands at 0\.3, 0\.3, 0\.5 .* 0\.49 m away"):
        kitchen.grasps_in_cloud(points, (0.3, 0.3, 0.5), gripper=urdf("panda"))
    with pytest.raises(ValueError, match="a point is x, y, z in metres"):
        kitchen.grasps_in_cloud(points, (0.3, float("nan"), 0.5), gripper=urdf("panda"))
    with pytest.raises(ValueError, match="does not exist"):
        kitchen.grasps_in_cloud("absent.ply", (0.1, 0.1, 0.1), gripper=urdf("panda"))
