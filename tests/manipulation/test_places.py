"""Where objects of the small house are put and pushed: what is free, stored and learned."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial import ConvexHull

from semmap import Map
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.ingest.meshes.mesh_file import read_mesh
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.places import find_places, place_of
from semmap.manipulation.pushes import find_pushes
from semmap.manipulation.ranking import ranked
from semmap.manipulation.reader import actions_on
from semmap.manipulation.retrieval import DEFAULT_GRIPPER, register_gripper, stored_gripper
from semmap.manipulation.store.actions import add_put
from semmap.manipulation.store.model_shapes import model_mesh
from semmap.manipulation.store.tasks import record_task
from tests.manipulation.grippers import BY_HAND
from tests.seen import seen_by

VASE, BOX = "Vase_01", "SeasoningBox_01"
TOP = shapely.box(0.4, 0.6, 2.0, 1.4)
"""The top of the table, at 0.75 m."""

HOLD = f"""
UPDATE semmap.placement SET holder_id = semmap.entity_id('robot'), relation = 'in', pose = %s
WHERE entity_id = semmap.entity_id('{BOX}')
"""


def area(points: Any) -> Any:
    return shapely.convex_hull(shapely.multipoints(points[:, :2]))


def placed(house: Map, name: str, pose: Pose | None = None) -> Any:
    """The vertices of an object in the map."""
    there = pose or Pose(*house[name].describe()["pose"])
    return there.apply(np.asarray(model_mesh(seen_by(house.connection), name).vertices))


def hand_at(gripper: Any, posture: int, pose: Any) -> Any:
    """All corners of the gripper at a pose of its grasp frame."""
    there = pose @ gripper.poses[posture]
    parts = [
        gripper.robot.hull(link) @ at[:3, :3].T + at[:3, 3]
        for link, at in zip(gripper.links, there, strict=True)
    ]
    return np.concatenate(parts)


def test_places_are_on_the_table_and_free_of_what_stands_there(house: Map) -> None:
    here = house.connection
    found = find_places(seen_by(here), VASE, "table", limit=6)
    assert found.generated == [VASE]
    assert len(found.rows) == 6
    again = find_places(seen_by(here), VASE, "table", limit=6)
    assert again.generated == []
    assert [r["action_id"] for r in again.rows] == [r["action_id"] for r in found.rows]
    gripper = stored_gripper(here, "parallel_gripper")
    other = area(placed(house, BOX))
    for row in found.rows:
        standing = placed(house, VASE, row["spot"])
        outline = area(standing)
        assert TOP.contains(outline)
        assert outline.distance(other) >= 0.01 - 1e-6
        gap = min(outline.distance(other), outline.distance(TOP.exterior))
        assert row["clearance"] == pytest.approx(gap, abs=2e-3)
        assert 0.75 < standing[:, 2].min() < 0.757
        # The gripper, open at both ends of its way back, is above the table and beside the box.
        for pose in (row["pose"], row["post_pose"]):
            corners = hand_at(gripper, 0, pose.matrix)
            assert corners[:, 2].min() > 0.75
        down = np.array(row["pre_pose"][:3]) - np.array(row["pose"][:3])
        np.testing.assert_allclose(down, (0, 0, 0.1), atol=1e-6)
        assert row["pose"].rotation_matrix == pytest.approx(
            row["pre_pose"].rotation_matrix, abs=1e-6
        )


def test_a_held_object_stands_as_it_stood_before(house: Map) -> None:
    """In the hand it is upside down; it is put as the robot found it, near the robot."""
    here = house.connection
    house.add_agent("robot", type="robot", size=(0.5, 0.5, 1.2), pose=(3.4, 2, 0))
    best = find_places(seen_by(here), BOX, "table", limit=1).rows[0]
    grasp = best["grasp_id"]
    record_task(here, BOX, action=grasp, outcome="completed", robot="robot")
    with house.transaction():
        house.execute(HOLD, [0.3, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    found = find_places(seen_by(here), BOX, "table", grasps=[grasp], limit=1)
    assert found.generated == []
    up = found.rows[0]["spot"].rotation_matrix[2]
    np.testing.assert_allclose(up, (0, 0, 1), atol=1e-6)
    near = find_places(seen_by(here), BOX, "table", towards=(2.0, 1.4), limit=3).rows
    assert max(np.hypot(row["spot"].x - 2.0, row["spot"].y - 1.4) for row in near) < 0.35
    assert place_of(seen_by(here), BOX, grasp) == found.rows[0]["action_id"]


def test_a_full_surface_and_one_that_is_none(house: Map) -> None:
    here = house.connection
    with pytest.raises(ManipulationError, match="Ball_01: has no level surface"):
        find_places(seen_by(here), VASE, "Ball_01")
    with pytest.raises(ManipulationError, match="cannot be put on itself"):
        find_places(seen_by(here), VASE, VASE)
    with pytest.raises(LookupError, match="no grasp 77"):
        find_places(seen_by(here), VASE, "table", grasps=[77])
    house.add_object("board", type="shelf", size=(1.6, 0.8, 0.02), pose=(1.2, 1.0, 1.15))
    found = find_places(seen_by(here), VASE, "table", limit=1)  # 40 cm below the board
    assert found.rows == []
    assert "table" in found.problems[0] or VASE in found.problems[0]


def test_outcomes_of_places_rank_them_and_teach_a_second_gripper(
    house: Map, tmp_path: Path
) -> None:
    here = house.connection
    register_gripper(here, DEFAULT_GRIPPER)
    (tmp_path / "plates.urdf").write_text(BY_HAND)
    register_gripper(here, tmp_path / "plates.urdf", "plates")
    first = find_places(seen_by(here), BOX, "table", gripper="parallel_gripper", limit=1).rows[0]
    for _ in range(6):
        record_task(here, BOX, "place", action=first["action_id"], outcome="error")
    second = find_places(seen_by(here), BOX, "table", gripper="parallel_gripper", limit=1).rows[0]
    assert second["action_id"] != first["action_id"]
    find_places(seen_by(here), BOX, "table", gripper="plates", limit=1)
    stored = actions_on(seen_by(here), name=BOX, kind="place", gripper="plates", limit=500)
    rows = ranked(here, stored, "plates", "place")
    taught = [r["expected"] for r in rows if r["family"] == first["family"]]
    others = [r["expected"] for r in rows if r["family"] != first["family"]]
    assert taught
    assert max(taught) < min(others)


def test_a_put_of_one_grasp_and_place_is_stored_once(house: Map) -> None:
    here = house.connection
    row = find_places(seen_by(here), BOX, "table", limit=1).rows[0]
    whole = add_put(here, row["grasp_id"], row["action_id"])
    assert add_put(here, row["grasp_id"], row["action_id"]) == whole
    (put,) = actions_on(seen_by(here), name=BOX, kind="put")
    assert put["action_id"] == whole


# -- pushes ---------------------------------------------------------------------------------------


def test_pushes_stay_on_the_table_and_meet_nothing(house: Map) -> None:
    """The box is pushed beside a wall of it: all that moves is free of it, by trimesh."""
    here = house.connection
    low, high = placed(house, BOX).min(axis=0), placed(house, BOX).max(axis=0)
    middle = (low + high) / 2
    wall = trimesh.creation.box((0.02, 0.5, 0.3))
    wall.apply_translation((high[0] + 0.05, middle[1], 0.9))
    house.add_object("wall", type="box", mesh=wall, pose=(0, 0, 0))
    found = find_pushes(seen_by(here), BOX, limit=16)
    assert found.generated == [BOX]
    assert find_pushes(seen_by(here), BOX, limit=16).generated == []
    directions = {row["direction"] for row in found.rows}
    assert 0 not in directions
    assert 180 not in directions  # the hand would stand in the wall
    assert directions
    gripper = stored_gripper(here, "parallel_gripper")
    solid = trimesh.collision.CollisionManager()
    solid.add_object("wall", wall)
    for row in found.rows:
        way = np.array(row["end"][:3]) - np.array(row["pose"][:3])
        assert np.hypot(*way[:2]) == pytest.approx(0.1)
        assert np.degrees(np.arctan2(way[1], way[0])) % 360 == pytest.approx(row["direction"])
        assert TOP.contains(area(placed(house, BOX) + way))
        for share in (0, 0.5, 1):
            moved = ConvexHull(placed(house, BOX) + share * way)
            corners = trimesh.Trimesh(moved.points, moved.simplices)
            assert not solid.in_collision_single(corners)
            pose = row["pose"].matrix.copy()
            pose[:3, 3] += share * way
            points = hand_at(gripper, len(gripper.postures) - 1, pose)
            assert not wall.contains(points).any()
            assert points[:, 2].min() > 0.75


def test_near_the_edge_pushes_lead_away_from_it(house: Map) -> None:
    here = house.connection
    size = np.ptp(placed(house, BOX), axis=0)
    with house.transaction():
        house[BOX].move_to(2.0 - size[0] / 2 - 0.03, 1.0, 0.75)
    rows = find_pushes(seen_by(here), BOX, limit=16).rows
    ways = [np.array(row["end"][:3]) - np.array(row["pose"][:3]) for row in rows]
    reach = placed(house, BOX)[:, 0].max()
    assert rows
    assert all(reach + way[0] < 2.0 for way in ways)


def test_outcomes_of_pushes_rank_them(house: Map) -> None:
    here = house.connection
    first = find_pushes(seen_by(here), BOX, limit=1).rows[0]
    for _ in range(4):
        record_task(here, BOX, "push", action=first["action_id"], outcome="error")
    assert find_pushes(seen_by(here), BOX, limit=1).rows[0]["action_id"] != first["action_id"]


def test_what_hangs_in_the_air_is_not_pushed(house: Map) -> None:
    with house.transaction():
        house[BOX].move_to(1.4, 1.0, 1.2)
    with pytest.raises(ManipulationError, match="stands on nothing level"):
        find_pushes(seen_by(house.connection), BOX)


def cabinet(open_front: bool) -> Mesh:
    """Panels of a cabinet of 0.6 x 0.5 x 0.8 m with a slanted top, and a board inside at 0.3 m."""

    def panel(size: tuple[float, ...], at: tuple[float, ...]) -> Any:
        return trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))

    lid = panel((0.7, 0.6, 0.02), (0, 0, 0))
    lid.apply_transform(trimesh.transformations.rotation_matrix(0.3, (1, 0, 0)))
    lid.apply_translation((0, 0, 0.88))
    panels = [
        lid,
        panel((0.02, 0.5, 0.8), (-0.3, 0, 0.4)),
        panel((0.02, 0.5, 0.8), (0.3, 0, 0.4)),
        panel((0.6, 0.02, 0.8), (0, 0.25, 0.4)),
        panel((0.58, 0.48, 0.02), (0, 0, 0.3)),
    ]
    if not open_front:
        panels.append(panel((0.6, 0.02, 0.8), (0, -0.25, 0.4)))
    whole: Any = trimesh.util.concatenate(panels)
    return Mesh(np.asarray(whole.vertices), np.asarray(whole.faces, np.int32))


@pytest.mark.parametrize("open_front", [True, False])
def test_a_thing_stands_inside_of_furniture_only_where_a_hand_gets_in(
    house: Map, open_front: bool
) -> None:
    """Rays between the hand and the outside, by trimesh, meet no panel."""
    here, mesh = house.connection, cabinet(open_front)
    house.add_object("cabinet", type="cabinet", mesh=mesh, pose=(3.2, 1.2, 0))
    rows = find_places(seen_by(here), BOX, "cabinet", limit=4).rows
    if not open_front:
        assert rows == []
        return
    assert rows
    panels = trimesh.Trimesh(mesh.vertices + np.array((3.2, 1.2, 0)), mesh.faces)
    for row in rows:
        assert 0.31 < placed(house, BOX, row["spot"])[:, 2].min() < 0.32
        for pose in (row["pre_pose"], row["post_pose"]):
            start, out = pose.translation, -pose.rotation_matrix[:, 2]
            assert not panels.ray.intersects_any([start], [out])[0]
            assert out[1] < -0.5  # through the front


def test_on_a_night_stand_comes_before_inside_of_it(house: Map, worlds: Path) -> None:
    folder = worlds / "small_house" / "models" / "aws_robomaker_residential_NightStand_01"
    mesh = read_mesh(next(folder.glob("meshes/*visual.DAE")), dae_up_axis=False)
    house.add_object("stand", type="nightstand", mesh=mesh, pose=(3.2, 1.2, 0))
    top = np.asarray(model_mesh(seen_by(house.connection), "stand").vertices)[:, 2].max()
    for row in find_places(seen_by(house.connection), BOX, "stand", limit=4).rows:
        assert abs(placed(house, BOX, row["spot"])[:, 2].min() - top) < 0.02
