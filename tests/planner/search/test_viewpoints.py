"""How a camera is held, what it shows, and what must be opened first."""

import math

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array

from planner.routing_graph import Endpoint
from planner.search import problem_builder
from planner.search.line_of_sight import LineOfSight
from planner.search.opened_furniture import enclosed, pose_before
from planner.search.viewpoints import HEADINGS, Aim, Sight, choose_views, views_from
from semmap.belief.places import BeliefPlace
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose

WALLS = {
    "left": ((-0.5, -0.3, 0), (-0.46, 0.3, 1)),
    "right": ((0.46, -0.3, 0), (0.5, 0.3, 1)),
    "back": ((-0.5, 0.26, 0), (0.5, 0.3, 1)),
    "front": ((-0.5, -0.3, 0), (0.5, -0.26, 1)),
    "top": ((-0.5, -0.3, 0.96), (0.5, 0.3, 1)),
    "bottom": ((-0.5, -0.3, 0), (0.5, 0.3, 0.04)),
}
"""The boards of a cupboard of 1 x 0.6 x 1 m: the lowest and highest corners."""


def boards(names):
    return np.concatenate([box_mesh(*WALLS[name]).triangles for name in names])


@given(st.floats(0, 3.2), st.integers(1, 3), st.integers(1, 3))
def test_a_camera_looks_in_all_directions_with_fewer_headings_if_the_head_turns(
    pan, heights, tilts
):
    sight = Sight(tuple(1 + 0.1 * np.arange(heights)), tuple(0.2 * np.arange(tilts)), pan)
    aims = sight.aims()
    assert len(aims) == HEADINGS * heights * tilts
    directions = {round(math.degrees(yaw + aim.pan)) % 360 for yaw, aim in aims}
    assert directions == set(range(0, 360, 360 // HEADINGS))
    assert all(abs(aim.pan) <= pan + 1e-9 for _, aim in aims)
    bases = {round(yaw, 6) for yaw, _ in aims}
    aside = math.floor(pan * HEADINGS / math.tau + 1e-9)  # directions that the head reaches
    assert len(bases) == math.ceil(HEADINGS / min(2 * aside + 1, HEADINGS))


@given(
    st.floats(-4, 4), st.floats(-1.4, 1.4), st.floats(-3, 3), st.floats(0.5, 2), st.integers(0, 99)
)
@settings(max_examples=50)
def test_what_is_in_the_picture_is_what_the_camera_projects_into_it(yaw, pitch, pan, height, seed):
    sight = Sight((height,), (pitch,), nearest=0.3, furthest=3.5)
    base, aim = Pose.planar(1.0, -2.0, yaw, 0.5), Aim(height, pitch, pan)
    pose = sight.pose(base, aim)
    assert pose[:3] == pytest.approx((1.0, -2.0, 0.5 + height))
    camera = sight.camera(pose, (400, 300))
    assert camera.pose[:3, 2] == pytest.approx(
        [
            math.cos(yaw + pan) * math.cos(pitch),
            math.sin(yaw + pan) * math.cos(pitch),
            -math.sin(pitch),
        ]
    )
    offsets = np.random.default_rng(seed).uniform(-4, 4, (500, 3))
    framed = sight.frames(offsets, yaw + pan, pitch)
    ahead = offsets @ camera.pose[:3, 2]
    image = camera.project(offsets[ahead > 0.31] + pose[:3])
    inside = ((image[:, :2] > 1) & (image[:, :2] < (399, 299))).all(axis=1)
    outside = ((image[:, :2] < -1) | (image[:, :2] > (401, 301))).any(axis=1)
    near = np.linalg.norm(offsets[ahead > 0.31], axis=1) <= 3.5
    assert framed[ahead > 0.31][inside & near].all()
    assert not framed[ahead > 0.31][outside | ~near].any()
    assert not framed[ahead < 0.3].any()


@pytest.mark.parametrize("missing", [(), ("bottom",), ("front",), ("top",), ("left", "back")])
def test_what_nothing_sees_from_outside_must_be_opened(missing):
    """A cupboard without a front, a bin without a lid; on its feet one does not look from below."""
    mesh = boards(WALLS.keys() - set(missing))
    low, high = np.array([-0.5, -0.3, 0]), np.array([0.5, 0.3, 1])
    place = BeliefPlace("cupboard", "object", (), low, high, stores=True)
    points = np.random.default_rng(0).uniform(low + 0.15, high - 0.15, (50, 3))
    blind = enclosed(points, [place] * len(points), LineOfSight(mesh, 0.02))
    if set(missing) <= {"bottom"}:
        assert blind.all()
        return
    assert not blind.any()
    scene = trimesh.Trimesh(mesh.reshape(-1, 3), np.arange(len(mesh) * 3).reshape(-1, 3))
    directions = np.random.default_rng(1).normal(size=(400, 3))
    for point in points[:10]:
        hit = scene.ray.intersects_any(np.tile(point, (400, 1)), directions)
        assert (~hit).mean() > 0.02


@pytest.mark.parametrize("height", [0.02, 0.06, 0.1, 0.14])
def test_a_low_object_on_a_board_of_an_open_shelf_is_seen(height):
    """The board and the object are in one voxel."""
    levels = (0.1, 0.45, 0.8, 1.2)
    inner = [box_mesh((-0.5, -0.15, z - 0.02), (0.5, 0.15, z)).triangles for z in levels]
    back = box_mesh((-0.5, 0.13, 0.0), (0.5, 0.15, 1.6)).triangles
    top = box_mesh((-0.5, -0.15, 1.58), (0.5, 0.15, 1.6)).triangles
    low, high = np.array([-0.5, -0.15, 0]), np.array([0.5, 0.15, 1.6])
    place = BeliefPlace("shelf", "object", (), low, high, stores=True)
    points = np.array([(x, 0.0, z + height / 2) for x in (-0.3, 0.0, 0.3) for z in levels])
    space = LineOfSight(np.concatenate([*inner, back, top]))
    assert not enclosed(points, [place] * len(points), space).any()


def test_what_is_in_a_low_shut_box_does_not_look_out_through_its_lid():
    """The point is in a solid block, from which the first free voxel above is outside."""
    sides = boards(WALLS) * (1, 1, 0.2)
    block = np.concatenate(
        [
            box_mesh((-0.1, -0.1, z - 0.01), (0.1, 0.1, z)).triangles
            for z in np.arange(0.02, 0.2, 0.02)
        ]
    )
    low, high = np.array([-0.5, -0.3, 0]), np.array([0.5, 0.3, 0.2])
    place = BeliefPlace("box", "object", (), low, high, stores=True)
    space = LineOfSight(np.concatenate([sides, block]))
    assert enclosed(np.array([(0.0, 0.0, 0.11)]), [place], space).all()


@given(st.integers(0, 10_000))
@settings(max_examples=40)
def test_the_chosen_views_are_those_of_the_greedy_cover(seed):
    """Also where points are in many views, as counts that are kept must stay exact."""
    draw = np.random.default_rng(seed)
    seen = draw.random((30, 60)) < draw.uniform(0.02, 0.3)
    weights, seconds = draw.random(60), draw.random(30)
    seconds[draw.random(30) < 0.2] = np.inf
    left, expected = weights.copy(), []
    whole = weights[seen[np.isfinite(seconds)].any(axis=0)].sum()
    while len(expected) < 12:
        gain = np.where(np.isfinite(seconds), seen @ left, -1)
        if gain.max() <= 0.002 * whole:
            break
        best = np.flatnonzero(gain >= gain.max() - 1e-9 * whole)
        expected.append(int(best[seconds[best].argmin()]))
        left[seen[expected[-1]]] = 0
    assert choose_views(csr_array(seen.astype(float)), weights, seconds, 12) == expected


def test_a_container_is_opened_from_its_own_room():
    """The nearest pose by time is behind the wall at which it stands."""
    outlines = {"hall": shapely.box(0, 0, 3, 3), "store": shapely.box(3.1, 0, 6, 3)}
    rooms = {name: BeliefPlace(name, "room", footprint=area) for name, area in outlines.items()}
    low, high = np.array([2.6, 1.0, 0]), np.array([3.0, 2.0, 2.0])
    wardrobe = BeliefPlace(
        "wardrobe", "object", (), low, high, shapely.box(2.6, 1, 3, 2), stores=True
    )
    none = np.empty(0)
    stands = [
        Endpoint(room, Pose.planar(x, 1.5, 0.0), none.astype(int), none, none)
        for room, x in (("store", 3.4), ("hall", 2.0), ("hall", 0.5))
    ]
    end = pose_before(wardrobe, stands, np.array([1.0, 9.0, 2.0]), rooms)
    assert (end.place, end.pose.x) == ("hall", 2.0)
    assert end.pose.yaw == pytest.approx(0)
    assert pose_before(wardrobe, stands[:1], np.ones(1), rooms) is None
    assert pose_before(wardrobe, stands, np.full(3, np.inf), rooms) is None


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        ([[1.0], [np.inf]], [0, np.inf]),  # a part of the room without a way out
        ([[np.inf], [np.inf]], [0, 0]),  # no way out at all
        ([[], []], [0, 0]),  # a room without doors
        ([], []),
    ],
)
def test_a_robot_anywhere_in_a_room_is_where_there_is_a_way_out(seconds, expected):
    stands = [
        Endpoint("hall", Pose.planar(k, 0.0, 0.0), np.arange(len(row)), np.array(row), None)
        for k, row in enumerate(seconds)
    ]
    start = Endpoint("hall", None, np.empty(0, int), np.empty(0), np.empty(0))
    assert problem_builder.seconds_from(None, start, stands).tolist() == expected


def test_a_low_camera_sees_what_a_table_hides_from_a_high_one():
    """The truth is that of rays of trimesh: a point is seen if nothing is before it."""
    table = box_mesh((0.4, -0.6, 0.7), (1.7, 0.6, 0.74)).triangles
    draw = np.random.default_rng(2)
    points = draw.uniform((0.7, -0.5, 0.05), (1.7, 0.5, 0.15), (150, 3))
    sight = Sight((0.5, 1.4), (0.0, 0.5, 0.9), furthest=3.0)
    views, shown = views_from(np.zeros((1, 2)), 0.0, points, LineOfSight(table, 0.02), sight)
    scene = trimesh.Trimesh(table.reshape(-1, 3), np.arange(len(table) * 3).reshape(-1, 3))
    seen = {}
    for (base, aim), numbers in zip(views, shown, strict=True):
        if base.yaw == pytest.approx(0, abs=1e-9):
            seen.setdefault(aim.height, set()).update(numbers.tolist())
        offsets = points - (0, 0, aim.height)
        hidden = scene.ray.intersects_any(np.tile((0, 0, aim.height), (150, 1)), offsets)
        visible = ~hidden & sight.frames(offsets, base.yaw + aim.pan, aim.pitch)
        assert (np.isin(np.arange(150), numbers) != visible).mean() < 0.06  # at edges of the table
    assert len(seen[0.5]) > len(seen.get(1.4, set())) + 50


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"heights": ()}, "above 0"),
        ({"heights": (1.0, -1.0)}, "above 0"),
        ({"pitches": (2.0,)}, "pi/2"),
        ({"pitches": ()}, "pi/2"),
        ({"pan": -1.0}, "0 or more"),
        ({"lift": 0.0}, "speed above 0"),
        ({"furthest": 0.1}, "nearer end"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        Sight(**options)
