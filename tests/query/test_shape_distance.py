"""The distance from a point to an entity's shape, against trimesh and against brute force."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import shapely
import trimesh

import semmap


@pytest.fixture(scope="module")
def yard(make_database: object) -> Iterator[semmap.Map]:
    with semmap.connect(str(make_database())) as db:  # type: ignore[operator]
        yield db.create_map("yard")


def distance(map: semmap.Map, name: str, point: np.ndarray) -> float:
    rows = map.execute(
        "SELECT shape_distance(id, %s, %s, %s) FROM entity "
        "WHERE map_id = current_map() AND name = %s",
        *map_floats(point),
        name,
    )
    return float(rows[0][0])


def map_floats(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in point)
    return x, y, z


def brute(triangles: np.ndarray, point: np.ndarray) -> float:
    """The least distance of a point to triangles, one at a time, by its parts: face, edges."""
    best = np.inf
    for a, b, c in triangles:
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        for p, q in ((a, b), (b, c), (c, a)):
            along = q - p
            t = np.clip((point - p) @ along / max(along @ along, 1e-300), 0, 1)
            best = min(best, float(np.linalg.norm(point - p - t * along)))
        if length > 0:
            height = (point - a) @ normal / length
            foot = point - height * normal / length
            sides = [np.cross(q - p, foot - p) @ normal for p, q in ((a, b), (b, c), (c, a))]
            if min(sides) >= 0:
                best = min(best, abs(float(height)))
    return best


SOLIDS = {
    "torus": lambda: trimesh.creation.torus(0.5, 0.15),
    "ring": lambda: trimesh.creation.annulus(0.2, 0.5, 0.3),
    "ball": lambda: trimesh.creation.icosphere(subdivisions=4, radius=0.7),
    "box": lambda: trimesh.creation.box((0.3, 0.8, 1.9)),
    "two": lambda: trimesh.util.concatenate(
        [
            trimesh.creation.box((0.2, 0.2, 0.2)),
            trimesh.creation.icosphere(radius=0.1).apply_translation((1, 0, 0)),
        ]
    ),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_closed_meshes_are_as_far_as_trimesh_says_and_zero_inside(
    yard: semmap.Map, name: str
) -> None:
    rng = np.random.default_rng(5)
    solid = SOLIDS[name]()
    thing = yard.add_object(name, mesh=solid, pose=(0, 0, 0))
    thing.move_to(3, -2, 1, 0.7)
    placed = solid.copy().apply_transform(thing.pose.matrix)
    low, high = placed.bounds
    points = rng.uniform(low - 0.3, high + 0.3, (60, 3))
    points = np.concatenate([points, rng.uniform(low - 9, high + 9, (10, 3)), placed.vertices[:3]])
    _, expected, _ = trimesh.proximity.closest_point(placed, points)
    expected[placed.contains(points)] = 0
    found = [distance(yard, name, point) for point in points]
    np.testing.assert_allclose(found, expected, atol=1e-7)
    assert (np.array(found[:60]) == 0).any() or name == "two"


def test_open_meshes_have_no_inside(yard: semmap.Map) -> None:
    rng = np.random.default_rng(6)
    shell = trimesh.creation.icosphere(subdivisions=2)
    shell.update_faces(np.arange(len(shell.faces)) >= 3)
    thing = yard.add_object("shell", mesh=shell, pose=(9, 9, 0, 1.0))
    triangles = shell.copy().apply_transform(thing.pose.matrix).triangles
    for point in rng.uniform((7.8, 7.8, -1.2), (10.2, 10.2, 1.2), (12, 3)):
        assert distance(yard, "shell", point) == pytest.approx(brute(triangles, point), abs=1e-7)


def test_a_large_mesh_is_read_in_part(yard: semmap.Map) -> None:
    """Many patches: the nearest one decides, wherever the point is."""
    rng = np.random.default_rng(8)
    ball = trimesh.creation.icosphere(subdivisions=6)
    noise = 1 + 0.03 * np.sin(9 * ball.vertices).sum(axis=1)
    ball.vertices *= noise[:, None]
    yard.add_object("planet", mesh=ball, pose=(30, 0, 0))
    placed = ball.copy().apply_translation((30, 0, 0))
    points = placed.sample(6, seed=1) + rng.normal(0, 0.1, (6, 3))
    points = np.concatenate([points, [(30, 0, 0), (50, 3, -9)]])
    expected = np.array([trimesh.proximity.closest_point(placed, [p])[1][0] for p in points])
    expected[placed.contains(points)] = 0
    found = [distance(yard, "planet", point) for point in points]
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_rooms_and_regions_are_zero_inside(yard: semmap.Map) -> None:
    rng = np.random.default_rng(9)
    area = shapely.Polygon([(0, 20), (6, 20), (6, 23), (3, 23), (3, 26), (0, 26)])
    yard.add_room("room", area, floor=0.2, ceiling=2.6)
    yard.add_region("zone", area, floor=0.2, ceiling=2.6)
    prism = trimesh.creation.extrude_polygon(area, 2.4).apply_translation((0, 0, 0.2))
    for point in rng.uniform((-1, 19, -1), (7, 27, 4), (60, 3)):
        inside = area.covers(shapely.Point(point[:2])) and 0.2 <= point[2] <= 2.6
        expected = 0 if inside else brute(prism.triangles, point)
        for name in ("room", "zone"):
            assert distance(yard, name, point) == pytest.approx(expected, abs=1e-7)


def test_without_geometry_it_is_the_pose(yard: semmap.Map) -> None:
    yard.add_object("bare", pose=(1, 2, 3))
    assert distance(yard, "bare", np.array([1, 2, 5.5])) == pytest.approx(2.5)
    yard.add_object("nowhere")
    assert yard.execute(
        "SELECT shape_distance(id, 0, 0, 0) FROM entity WHERE name = 'nowhere'"
    ) == [(None,)]


def test_find_measures_to_the_shape_not_to_the_box(yard: semmap.Map) -> None:
    """In the hole of a torus: inside of its box, away from its surface."""
    big = trimesh.creation.torus(2, 0.1)
    yard.add_object("hoop", mesh=big, pose=(100, 0, 0))
    yard.add_object("dot", size=(0.2, 0.2, 0.2), pose=(101, 0, -0.1))
    rows = yard.table("object", near=(100, 0, 0), within=1.95, box=(95, -5, -1, 105, 5, 1))
    assert [(row["name"], float(row["distance"])) for row in rows] == [
        ("dot", 0.9),
        ("hoop", pytest.approx(brute(big.triangles, np.zeros(3)), abs=1e-3)),
    ]
    assert [one.name for one in yard.find(near=(100, 0, 0), limit=1)] == ["dot"]
    assert yard.find(near=(100, 0, 0), within=0.8) == []
