"""Lines through the openings of doors: Shapely says which of them random solids meet."""

import random

import numpy as np
import pytest
import shapely
import trimesh

from semmap.geometry.pose import Pose
from semmap.query.map_check.building import LINTEL, WALL
from semmap.query.map_check.doorways import GROUND, PASSAGE, DoorOpening


def solid(draw: random.Random) -> tuple[shapely.Polygon, trimesh.Trimesh]:
    """A turned prism of random outline, or a ring of walls, and its ground."""
    if draw.random() < 0.3:
        half = draw.uniform(0.3, 3)
        ground = shapely.box(-half, -half, half, half).difference(
            shapely.box(*(v * (half - 0.2) for v in (-1, -1, 1, 1)))
        )
    else:
        spots = [(draw.uniform(-1, 1), draw.uniform(-1, 1)) for _ in range(6)]
        ground = shapely.MultiPoint(spots).convex_hull
    ground = shapely.affinity.scale(ground, draw.uniform(0.2, 2), draw.uniform(0.05, 2))
    ground = shapely.affinity.rotate(ground, draw.uniform(0, 360))
    ground = shapely.affinity.translate(ground, draw.uniform(-1.5, 1.5), draw.uniform(-1.5, 1.5))
    low = draw.choice([-0.5, 0.0, 0.3, draw.uniform(0, 1.4), 1.6])
    mesh = trimesh.creation.extrude_polygon(ground, draw.choice([0.05, draw.uniform(0.2, 2.5)]))
    mesh.apply_translation((0, 0, low))
    return ground, mesh


def spans_of(ground: shapely.Geometry, width: float) -> shapely.Geometry:
    """What Shapely says that a ground takes of an opening, as lines along y."""
    strip = shapely.box(-WALL, -width / 2, WALL, width / 2)
    parts = [p.bounds for p in shapely.get_parts(ground.intersection(strip)) if p.area > 0]
    return shapely.union_all([shapely.LineString([(0, y0), (0, y1)]) for _, y0, _, y1 in parts])


@pytest.mark.parametrize("seed", range(100))
def test_what_is_taken_is_what_shapely_finds(seed: int) -> None:
    draw = random.Random(seed)
    ground, mesh = solid(draw)
    width = draw.uniform(0.5, 2)
    door = Pose.planar(draw.uniform(-9, 9), draw.uniform(-9, 9), draw.uniform(-4, 4), 3.0)
    low, high = mesh.bounds[:, 2]
    faces = door.apply(mesh.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    spans = DoorOpening(door, width, {"it": faces}).taken("it")
    found = shapely.union_all([shapely.LineString([(0, a), (0, b)]) for a, b in spans])
    expected = shapely.LineString()
    if high >= GROUND and low <= LINTEL:
        expected = spans_of(ground, width)
    assert found.difference(expected.buffer(1e-5)).length < 1e-4
    assert expected.difference(found.buffer(1e-5)).length < 1e-4


@pytest.mark.parametrize("seed", range(20))
def test_slanted_faces_take_what_their_sections_do(seed: int) -> None:
    """Boxes turned in space, against the sections of trimesh at many heights."""
    draw = np.random.default_rng(seed)
    mesh = trimesh.creation.box(draw.uniform(0.1, 1, 3))
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(draw.random(3)))
    mesh.apply_translation([*draw.uniform(-0.4, 0.4, 2), draw.uniform(0, 1.6)])
    spans = DoorOpening(Pose(), 1.0, {"it": mesh.triangles}).taken("it")
    strip = shapely.box(-WALL, -0.5, WALL, 0.5)
    low, high = np.inf, -np.inf
    for height in np.linspace(GROUND, LINTEL, 1500):
        section = trimesh.intersections.mesh_plane(mesh, (0, 0, 1), (0, 0, height))
        hull = shapely.MultiPoint(section[:, :, :2].reshape(-1, 2)).convex_hull
        part = hull.intersection(strip)
        if not part.is_empty:
            low, high = min(low, part.bounds[1]), max(high, part.bounds[3])
    assert len(spans) == (low < high)
    for a, b in spans:
        assert (a, b) == pytest.approx((low, high), abs=5e-3)
        assert a <= low + 1e-5
        assert b >= high - 1e-5


def beam(y0: float, y1: float, z0: float, z1: float) -> np.ndarray:
    at = trimesh.transformations.translation_matrix((0, (y0 + y1) / 2, (z0 + z1) / 2))
    return np.asarray(trimesh.creation.box((0.1, y1 - y0, z1 - z0), transform=at).triangles)


@pytest.mark.parametrize(
    ("width", "solids", "says"),
    [
        (0.9, {"post": (0.15, 0.45, 0, 2)}, None),
        (0.9, {"post": (0.149, 0.45, 0, 2)}, "narrower than 0.599 m"),
        (0.9, {"post": (-0.1, 0.45, 0, 2)}, "narrower than 0.350 m"),
        (0.9, {"wall": (-0.45, 0.45, 0, 2)}, "no robot passes"),
        (0.9, {"sill": (-0.45, 0.45, 0, 0.02)}, None),
        (0.9, {"sill": (-0.45, 0.45, 0, 0.022)}, "climbs 0.022 m"),
        (0.9, {"sill": (-0.45, 0.45, -1, 0.1)}, "climbs 0.100 m"),
        (0.9, {"lintel": (-0.45, 0.45, 1.5, 2)}, "lower than 1.50 m"),
        (0.9, {"lintel": (-0.45, 0.45, 1.501, 2)}, None),
        (0.9, {"lintel": (-0.45, 0.2, 1.2, 2)}, "lower than 1.20 m"),
        (0.9, {"sill": (-0.45, 0.2, 0, 0.05), "post": (0.2, 0.45, 0, 2)}, "climbs 0.050 m"),
        (0.9, {"sill": (-1, 1, 0, 0.05), "beam": (-1, 1, 1.2, 1.3)}, "no robot 0.6 m wide"),
        (0.5, {"frame": (-0.25, -0.2, 0, 2)}, None),  # nearly all of it is left
        (0.5, {"frame": (-0.25, -0.05, 0, 2)}, "narrower than 0.300 m"),
    ],
)
def test_what_closes_an_opening_says_who_passes(
    width: float, solids: dict[str, tuple[float, ...]], says: str | None
) -> None:
    door = Pose.planar(3, -2, 1.1, 0.5)
    faces = {
        name: door.apply(beam(*ends).reshape(-1, 3)).reshape(-1, 3, 3)
        for name, ends in solids.items()
    }
    opening = DoorOpening(door, width, faces)
    shut = opening.closing([*solids])
    assert bool(shut) == (says is not None)
    if says is not None:
        assert says in opening.passing([*solids])


@pytest.mark.parametrize("seed", range(20))
def test_a_robot_may_be_as_high_as_the_lowest_beam(seed: int) -> None:
    """Beams over an opening of 1.2 m, or over one half of it: a robot passes beneath the other."""
    draw = random.Random(seed)
    door = Pose.planar(draw.uniform(-9, 9), draw.uniform(-9, 9), draw.uniform(-4, 4), 3.0)
    beams, lowest = [], {"left": 9.0, "right": 9.0}
    for half in draw.sample(["left", "right", "both"], draw.randint(1, 3)):
        low = draw.uniform(0.25, 1.3)
        y = {"left": (-0.6, 0.0), "right": (0.0, 0.6), "both": (-0.7, 0.7)}[half]
        beams.append(beam(*y, low, low + 0.04))
        for side in lowest.keys() & {half} or lowest:
            lowest[side] = min(lowest[side], low)
    faces = door.apply(np.concatenate(beams).reshape(-1, 3)).reshape(-1, 3, 3)
    opening = DoorOpening(door, 2 * PASSAGE, {"beams": faces})
    expected = max(lowest.values())
    assert bool(opening.closing(["beams"])) == (expected < LINTEL)
    if expected < LINTEL:
        assert f"lower than {expected:.2f} m" in opening.passing(["beams"])
