"""Places on surfaces and pushes along them, beside Shapely and rays in the small house."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh
from shapely import Polygon

from semmap.geometry.mesh import box_mesh
from semmap.geometry.surfaces import LevelPatch
from semmap.manipulation.collision import Obstacles
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.placing import place_candidates
from semmap.manipulation.pushing import free_pushes, push_candidates
from semmap.manipulation.solids import solid_of
from tests.manipulation.grippers import JAW, gripper_by_hand

TRAY = solid_of("cuboid", (0.3, 0.1, 0.04)).mesh().vertices


def patch(outline, height=0.7):
    return LevelPatch(height, outline, outline.area, np.arange(2))


def seen_from_above(vertices, pose):
    return shapely.convex_hull(
        shapely.multipoints((vertices @ pose[:3, :3].T + pose[:3, 3])[:, :2])
    )


def test_places_on_a_board_beside_a_box():
    board = patch(Polygon([(0, 0), (0.6, 0), (0.6, 0.25), (0, 0.25)]))
    box = box_mesh((0.0, 0.0, 0.7), (0.2, 0.25, 0.9)).triangles
    places = place_candidates(TRAY, np.eye(4), [board], box)
    assert places
    assert [p.clearance for p in places] == sorted((p.clearance for p in places), reverse=True)
    for place in places:
        area = seen_from_above(TRAY, place.pose)
        assert shapely.Polygon([(0.2, 0), (0.6, 0), (0.6, 0.25), (0.2, 0.25)]).contains(area)
        assert place.clearance >= 0.01 - 1e-9
        lowest = (TRAY @ place.pose[:3, :3].T + place.pose[:3, 3])[:, 2].min()
        assert 0.7 < lowest < 0.71


def test_too_small_and_too_full_surfaces():
    small = patch(Polygon([(0, 0), (0.2, 0), (0.2, 0.09), (0, 0.09)]))
    assert place_candidates(TRAY, np.eye(4), [small], np.zeros((0, 3, 3))) == []
    board = patch(Polygon([(0, 0), (0.6, 0), (0.6, 0.25), (0, 0.25)]))
    shelf = box_mesh((0, 0, 0.73), (0.6, 0.25, 0.75)).triangles  # 3 cm above: too low for 4 cm
    assert place_candidates(TRAY, np.eye(4), [board], shelf) == []
    assert place_candidates(TRAY, np.eye(4), [board], shelf + np.array((0, 0, 0.1)))
    with pytest.raises(ManipulationError, match="seen from above it has no area"):
        place_candidates(TRAY * [1, 0, 1], np.eye(4), [board], np.zeros((0, 3, 3)))


def test_places_on_the_kitchen_table_are_free_of_its_dishes(kitchen):
    """Rays from above meet the table top, and nothing higher, all over each place."""
    cup = solid_of("cylinder", (0.04, 0.1)).mesh(16).vertices
    top = kitchen.top
    near = Obstacles(kitchen.triangles).within(
        np.array([*top.outline.bounds[:2], top.height - 0.1]),
        np.array([*top.outline.bounds[2:], top.height + 0.4]),
    )
    places = place_candidates(cup, np.eye(4), [top], near.triangles, spacing=0.1)
    assert len(places) > 10
    room = trimesh.Trimesh(**trimesh.triangles.to_kwargs(near.triangles))
    for place in places[:: max(1, len(places) // 12)]:
        angle = np.linspace(0, 2 * np.pi, 12)
        ring = 0.04 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        starts = place.pose[:3, 3] + ring + [0, 0, 0.04]
        hits, ray, _ = room.ray.intersects_location(starts, np.tile([0, 0, -1.0], (12, 1)))
        for i in range(12):
            assert hits[ray == i, 2].max() == pytest.approx(top.height, abs=0.006)


def test_pushes_stay_on_the_table_and_meet_nothing(tmp_path):
    gripper = gripper_by_hand(tmp_path)
    table = Polygon([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.16), (-0.5, 0.16)])
    wood = box_mesh((-0.5, -0.5, -0.05), (0.5, 0.16, 0.0)).triangles
    cup = box_mesh((0.1, -0.05, 0.0), (0.15, 0.05, 0.12)).triangles
    item = solid_of("cuboid", (0.06, 0.06, 0.2)).mesh().vertices
    model = np.eye(4)
    model[2, 3] = 0.1
    pushes = push_candidates(item, model, gripper)

    def free(surface, triangles):
        there = (item, model, gripper, surface, Obstacles(triangles))
        return [pushes[i] for i in np.flatnonzero(free_pushes(pushes, *there))]

    alone = free(table, wood)
    beside = free(table, np.concatenate([wood, cup]))
    assert len(alone) == 16
    met = {round(float(np.degrees(np.arctan2(*p.direction[::-1])))) % 360 for p in beside}
    assert 0 not in met
    assert 180 not in met  # the hand would be where the cup is
    assert {90, 270} <= met
    for push in alone:
        reached = seen_from_above(item, model)
        moved = shapely.affinity.translate(reached, *(push.distance * push.direction))
        assert table.contains(moved)
        tip = push.pose[:3, 3] + (gripper.reaches[-1] + 0.01) * push.pose[:3, 2]
        assert reached.boundary.distance(shapely.Point(tip[:2])) < 1e-9
        np.testing.assert_allclose(push.end[:2, 3] - push.pose[:2, 3], 0.1 * push.direction)
    assert alone[0].quality == pytest.approx(1)
    near_edge = free(shapely.box(-0.5, -0.5, 0.5, 0.12), wood)
    assert all(push.direction[1] < 0.9 for push in near_edge)


def test_closed_jaws_push_where_their_ends_are(tmp_path):
    """The ends of one jaw that moves are at the other one when closed, not in the middle."""
    path = tmp_path / "jaw.urdf"
    path.write_text(JAW)
    gripper = read_gripper(path)
    box = solid_of("cuboid", (0.06, 0.06, 0.06)).mesh()
    model = np.eye(4)
    model[2, 3] = 0.03
    ends = []
    for pose, hull in zip(gripper.poses[-1], gripper.hulls, strict=True):
        corners = hull @ pose[:3, :3].T + pose[:3, 3]
        ends.append(corners[corners[:, 2] > gripper.reaches[-1]])  # above the middle of the pads
    middle = np.concatenate(ends)[:, 0]
    for push in push_candidates(box.vertices, model, gripper, distance=0.05):
        aside = push.pose[:3, 0] * (middle.min() + middle.max()) / 2
        x, y, _ = push.pose[:3, 3] + aside
        beside = push.direction[0] * y - push.direction[1] * x
        assert abs(beside) < 0.002  # they meet the middle of the box
