"""Voxels of regions against point-in-solid tests of each centre, and of each cell where thin."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from semmap.fields import (
    Box,
    Cone,
    Cylinder,
    DepthImage,
    Hull,
    Solid,
    Sphere,
    SurfaceRegion,
    voxels_of,
)

Floats = NDArray[np.float64]

CLOSE = 1e-7
"""Voxels this near to a surface may be in or out."""

numbers = st.floats(-3, 3, width=32)
places = st.tuples(numbers, numbers, numbers)
lengths = st.floats(0.5, 2)
sizes = st.sampled_from([0.1, 0.125, 0.2, 0.25])
turns = st.integers(0, 1000).map(
    lambda seed: Rotation.random(rng=np.random.default_rng(seed)) if seed else Rotation.identity()
)
quick = settings(deadline=None, max_examples=30)


def cells(low: Floats, high: Floats, size: float) -> NDArray[np.int64]:
    first, last = np.floor(low / size).astype(int) - 2, np.floor(high / size).astype(int) + 2
    axes = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def expect(region: object, depth: Floats, grid: NDArray[np.int64], size: float) -> None:
    """`depth`: how far inside each centre lies, in metres; negative outside."""
    found = voxels_of(region, size)  # type: ignore[arg-type]
    got = set(map(tuple, found.tolist()))
    assert len(got) == len(found)
    must = set(map(tuple, grid[depth > CLOSE * size].tolist()))
    may = set(map(tuple, grid[depth > -CLOSE * size].tolist()))
    if may:
        assert must <= got <= may
    else:  # between all centres: what it meets
        assert got <= set(map(tuple, grid[depth > -math.sqrt(3) * size].tolist()))
        assert got


@quick
@given(places, st.tuples(lengths, lengths, lengths), turns, sizes)
def test_box(center: Floats, extent: Floats, turn: Rotation, size: float) -> None:
    """A turned box holds the centres that lie between all its faces."""
    reach = float(np.linalg.norm(extent)) / 2
    grid = cells(np.array(center) - reach, np.array(center) + reach, size)
    local = np.abs(turn.inv().apply((grid + 0.5) * size - center))
    region = Box(center, extent, turn.as_quat())
    expect(region, (np.array(extent) / 2 - local).min(axis=1), grid, size)


@quick
@given(places, lengths, sizes)
def test_sphere(center: Floats, radius: float, size: float) -> None:
    """A sphere holds the centres within its radius."""
    grid = cells(np.array(center) - radius, np.array(center) + radius, size)
    away = np.linalg.norm((grid + 0.5) * size - center, axis=1)
    expect(Sphere(center, radius), radius - away, grid, size)


@quick
@given(places, lengths, lengths, turns, sizes)
def test_cylinder(
    center: Floats, radius: float, height: float, turn: Rotation, size: float
) -> None:
    """A turned cylinder holds the centres near its axis and between its ends."""
    axis = turn.apply([0, 0, 1])
    reach = radius + height
    grid = cells(np.array(center) - reach, np.array(center) + reach, size)
    local = turn.inv().apply((grid + 0.5) * size - center)
    depth = np.minimum(
        radius - np.hypot(local[:, 0], local[:, 1]), height / 2 - np.abs(local[:, 2])
    )
    expect(Cylinder(center, radius, height, 3 * axis), depth, grid, size)


@quick
@given(places, st.floats(0.4, 2.6), st.floats(1, 2), turns, sizes)
def test_cone(apex: Floats, angle: float, height: float, turn: Rotation, size: float) -> None:
    """A turned cone holds the centres within half its angle of the axis, up to its base."""
    reach = height / math.cos(angle / 2)
    grid = cells(np.array(apex) - reach, np.array(apex) + reach, size)
    local = turn.inv().apply((grid + 0.5) * size - apex)
    side = local[:, 2] * math.sin(angle / 2)
    side -= np.hypot(local[:, 0], local[:, 1]) * math.cos(angle / 2)
    region = Cone(apex, turn.apply([0, 0, 1]), angle, height)
    expect(region, np.minimum(side, height - local[:, 2]), grid, size)


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0), (1, 0, 1)])
def test_cone_along_its_own_side(axis: tuple[float, ...]) -> None:
    """Columns parallel to a cone's surface leave it once or never."""
    direction = np.array(axis) / np.linalg.norm(axis)
    grid = cells(np.full(3, -2.5), np.full(3, 2.5), 0.1)
    points = (grid + 0.5) * 0.1
    along = points @ direction
    across = np.linalg.norm(points - along[:, None] * direction, axis=1)
    depth = np.minimum((along - across) * math.sqrt(0.5), 1.5 - along)
    expect(Cone((0, 0, 0), axis, math.pi / 2, 1.5), depth, grid, 0.1)


@quick
@given(st.integers(0, 10_000), sizes)
def test_hull(seed: int, size: float) -> None:
    """A hull holds the centres below all facets of an independent hull."""
    random = np.random.default_rng(seed)
    points = random.uniform(-1, 1, (random.integers(8, 30), 3)) + random.uniform(-3, 3, 3)
    mesh = trimesh.convex.convex_hull(points)
    grid = cells(points.min(axis=0), points.max(axis=0), size)
    offset = np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles[:, 0])
    depth = (offset - (grid + 0.5) * size @ mesh.face_normals.T).min(axis=1)
    expect(Hull(points), depth, grid, size)


@quick
@given(st.integers(0, 10_000), sizes, st.booleans())
def test_solid_of_a_hull_is_the_hull(seed: int, size: float, mirrored: bool) -> None:
    """The same polytope as a mesh, turned inside out or not, has the same voxels."""
    random = np.random.default_rng(seed)
    points = random.uniform(-1, 1, (20, 3)) + random.uniform(-3, 3, 3)
    if mirrored:
        points[:, 0] *= -1
    mesh = trimesh.convex.convex_hull(points)
    faces = mesh.faces[:, ::-1] if mirrored else mesh.faces
    hull = set(map(tuple, voxels_of(Hull(points), size).tolist()))
    solid = set(map(tuple, voxels_of(Solid(mesh.vertices, faces), size).tolist()))
    assert hull == solid


def torus() -> trimesh.Trimesh:
    return trimesh.creation.torus(1.0, 0.4, major_sections=16, minor_sections=8)


@settings(deadline=None, max_examples=6)
@given(turns, places)
def test_solid_that_is_not_convex(turn: Rotation, place: Floats) -> None:
    """A turned torus holds the centres that its winding number says."""
    mesh = torus()
    vertices = turn.apply(mesh.vertices) + place
    grid = cells(vertices.min(axis=0), vertices.max(axis=0), 0.25)
    triangles = vertices[mesh.faces] - ((grid + 0.5) * 0.25)[:, None, None]
    a, b, c = triangles[:, :, 0], triangles[:, :, 1], triangles[:, :, 2]
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    volume = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
    rest = la * lb * lc + np.einsum("nfi,nfi->nf", a, b) * lc
    rest += np.einsum("nfi,nfi->nf", b, c) * la + np.einsum("nfi,nfi->nf", c, a) * lb
    winding = np.arctan2(volume, rest).sum(axis=1) / (2 * math.pi)
    inside = set(map(tuple, grid[np.abs(winding) > 0.5].tolist()))
    got = set(map(tuple, voxels_of(Solid(vertices, mesh.faces), 0.25).tolist()))
    assert got == inside


def test_solids_that_overlap_or_are_hollow() -> None:
    """Overlapping parts are one; a part turned inwards is a cavity; vertices need not be shared."""
    box = trimesh.creation.box((2, 2, 2))
    shifted = box.vertices + np.array((1, 0, 0))
    both = Solid(
        np.concatenate([box.vertices, shifted]), np.concatenate([box.faces, box.faces + 8])
    )
    assert len(voxels_of(both, 0.1)) == 30 * 20 * 20
    inner = box.vertices / 2
    hollow = np.concatenate([box.faces, box.faces[:, ::-1] + 8])
    assert len(voxels_of(Solid(np.concatenate([box.vertices, inner]), hollow), 0.1)) == 7000
    soup = box.triangles.reshape(-1, 3)
    assert len(voxels_of(Solid(soup, np.arange(36).reshape(-1, 3)), 0.1)) == 8000


def meets(corners: Floats, cell: NDArray[np.int64], size: float, slack: float) -> bool:
    """Whether the hull of the corners and a cell, wider by slack, share a point."""
    weights = len(corners)
    low, high = cell * size - slack, (cell + 1) * size + slack
    return bool(
        linprog(
            np.zeros(weights),
            A_ub=np.concatenate([corners.T, -corners.T]),
            b_ub=np.concatenate([high, -low]),
            A_eq=np.ones((1, weights)),
            b_eq=[1],
        ).success
    )


@settings(deadline=None, max_examples=4)
@given(
    st.sampled_from([(1, 1, 0), (1, 0.7, 0.05), (1.2, 0.1, 0.1), (1, 0, 0), (0.1, 0.2, 0.1)]),
    turns,
    places,
)
def test_thin_box(extent: Floats, turn: Rotation, center: Floats) -> None:
    """All cells that a thin box meets belong to it, and no other, as linear programs say."""
    size = 0.25
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = turn.apply(signs * np.array(extent) / 2) + center
    found = set(map(tuple, voxels_of(Box(center, extent, turn.as_quat()), size).tolist()))
    assert found == set(map(tuple, voxels_of(Hull(corners), size).tolist()))
    for cell in cells(corners.min(axis=0), corners.max(axis=0), size):
        if tuple(cell.tolist()) in found:
            assert meets(corners, cell, size, 1e-6)
        else:
            assert not meets(corners, cell, size, -1e-6)


@pytest.mark.parametrize("radius", [0.02, 0.05, 0.07])
def test_thin_solids_are_without_gaps(radius: float) -> None:
    """Rods, discs, small balls and thin cones hold each voxel that a point of theirs lies in."""
    random = np.random.default_rng(1)
    for _ in range(20):
        center = random.uniform(-2, 2, 3)
        turn = Rotation.random(rng=random)
        axis = turn.apply([0, 0, 1])
        at, around = random.uniform(0, 1, 4000), random.uniform(0, 2 * math.pi, 4000)
        out = np.sqrt(random.uniform(0, 1, 4000))
        ring = np.stack([out * np.cos(around), out * np.sin(around), np.zeros(4000)], 1)
        line = np.outer(at, [0, 0, 1])
        for region, points in (
            (Cylinder(center, radius, 1, axis), radius * ring + line - [0, 0, 0.5]),
            (
                Cylinder(center, 0.7, radius / 3, axis),
                0.7 * ring + radius / 3 * (line - [0, 0, 0.5]),
            ),
            (Cone(center, axis, 2 * math.atan(radius), 1), radius * ring * at[:, None] + line),
        ):
            touched = np.floor((turn.apply(points) + center) / 0.1).astype(int)
            found = set(map(tuple, voxels_of(region, 0.1).tolist()))
            assert set(map(tuple, touched.tolist())) <= found
        low, high = np.floor((center - radius) / 0.1), np.floor((center + radius) / 0.1)
        ball = voxels_of(Sphere(center, radius), 0.1)
        assert (ball >= low).all()
        assert (ball <= high).all()
        assert len(ball) >= 1


def test_thin_parts_of_a_mesh() -> None:
    """The legs of a table are parts of their own: none is lost between centres."""
    top = trimesh.creation.box(
        (1, 1, 0.02), trimesh.transformations.translation_matrix((0, 0, 0.7))
    )
    legs = [
        trimesh.creation.box((0.03, 0.03, 0.7), trimesh.transformations.translation_matrix(place))
        for place in ((0.401, 0.401, 0.35), (-0.403, 0.401, 0.35))
    ]
    table = trimesh.util.concatenate([top, *legs])
    found = set(map(tuple, voxels_of(Solid(table.vertices, table.faces), 0.1).tolist()))  # type: ignore[attr-defined]
    for z in range(7):
        assert (4, 4, z) in found
        assert (-5, 4, z) in found
    assert len([v for v in found if v[2] == 7 or v[2] == 6]) >= 100


def test_surface_is_without_holes() -> None:
    """Each voxel that a point of a surface lies in belongs to it."""
    mesh = torus()
    points = trimesh.sample.sample_surface(mesh, 20_000, seed=1)[0]
    touched = set(map(tuple, np.floor(points / 0.1).astype(int).tolist()))
    found = voxels_of(SurfaceRegion(mesh.vertices, mesh.faces), 0.1)
    assert touched <= set(map(tuple, found.tolist()))
    depth = trimesh.proximity.closest_point(mesh, (found + 0.5) * 0.1)[1]
    assert depth.max() <= 0.1 * math.sqrt(3) / 2 + 1e-9


def test_points() -> None:
    """A point belongs to the voxel floor(p / size), below zero too; each voxel once."""
    points = np.array([(0.05, -0.05, 0), (0.09, -0.01, 0.0), (-1e-9, 1, 1), (7.999, 8, 15.95)])
    found = voxels_of(points, 0.1).tolist()
    assert sorted(found) == [[-1, 10, 10], [0, -1, 0], [79, 80, 159]]
    assert voxels_of(np.zeros((0, 3)), 0.1).shape == (0, 3)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Sphere((0, 0), 1), r"Sphere\.center"),
        (lambda: Sphere((0, 0, 0), 0), r"Sphere\.radius"),
        (lambda: Sphere((0, 0, math.nan), 1), r"Sphere\.center"),
        (lambda: Box((0, 0, 0), (1, -1, 1)), r"Box\.size"),
        (lambda: Box((0, 0, 0), (1, 1, 1), (0, 0, 0, 2)), "unit quaternion"),
        (lambda: Cylinder((0, 0, 0), 1, 1, (0, 0, 0)), r"Cylinder\.axis"),
        (lambda: Cone((0, 0, 0), (0, 0, 1), 4, 1), "full opening angle"),
        (lambda: Hull(np.zeros((0, 3))), "at least one point"),
        (lambda: Solid(np.eye(3), [[0, 1, 2]]), "not closed"),
        (lambda: Solid(np.eye(3), [[0, 1, 3]]), "vertices 0 to 2"),
        (lambda: voxels_of(np.zeros((4, 2)), 0.1), r"\(N, 3\)"),
        (lambda: voxels_of(np.full((1, 3), np.inf), 0.1), "NaN or infinity"),
        (lambda: voxels_of(Sphere((0, 0, 0), 1), 0), "voxel_size"),
        (lambda: voxels_of(Sphere((1e12, 0, 0), 1), 0.1), "nearer frame"),
        (lambda: voxels_of(Box((0, 0, 0), (1e5, 1e5, 1e5)), 0.1), "larger voxels"),
    ],
)
def test_wrong_regions_are_refused(make: object, text: str) -> None:
    """A wrong region is refused with its fix."""
    with pytest.raises(ValueError, match=text):
        make()  # type: ignore[operator]


def test_depth_image() -> None:
    """Pixels lie where the pinhole puts them; the masked, the far and the empty are left out."""
    random = np.random.default_rng(3)
    depth = random.uniform(0.5, 4, (48, 64)).astype(np.float32)
    depth[0] = np.nan
    depth[1] = 0
    depth[2] = np.inf
    depth[3] = -1
    mask = random.uniform(size=depth.shape) < 0.5
    turn, shift = Rotation.random(rng=random), random.uniform(-3, 3, 3)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.as_matrix(), shift
    rows, columns = np.nonzero(mask & (depth > 0) & (depth <= 3))
    d = depth[rows, columns].astype(float)
    points = np.stack([(columns - 31.5) / 50 * d, (rows - 23.5) / 60 * d, d], 1)
    region = DepthImage(depth, (50, 60, 31.5, 23.5), pose, mask, 3)
    found = voxels_of(region, 0.1)
    wanted = voxels_of(turn.apply(points) + shift, 0.1)
    assert set(map(tuple, found.tolist())) == set(map(tuple, wanted.tolist()))
    assert len(voxels_of(DepthImage(depth, (50, 60, 31.5, 23.5), pose), 0.1)) > len(found)
    for bad in ({"mask": mask[1:]}, {"pose": 2 * pose}, {"intrinsics": (0, 1, 1, 1)}):
        arguments = {"depth": depth, "intrinsics": (50, 60, 31.5, 23.5), "pose": pose, **bad}
        with pytest.raises(ValueError, match="DepthImage"):
            DepthImage(**arguments)
