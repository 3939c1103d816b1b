"""The small house as voxels: each within its thing's box, on its surface or inside of a solid."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray
from sqlalchemy import Engine

from semmap.fields.store.reader import read_occupants
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.geometry.parts import closed_parts
from semmap.geometry.tin import to_mesh
from tests.oracles.region_map import check_region_map
from tests.seen import seen_by

SIZE = 0.05


def test_every_thing_has_its_voxels(bare_house: Engine) -> None:
    mirror = VoxelMirror(bare_house, "house", SIZE)
    assert len(mirror.catch_up()) == 87
    check_region_map(mirror.regions._native)
    with bare_house.connect() as connection:
        things = read_occupants(seen_by(connection))
    random = np.random.default_rng(3)
    far = 0
    for thing in things:
        voxels = mirror.regions.voxels(thing.id)
        low, high = thing.triangles.min(axis=(0, 1)), thing.triangles.max(axis=(0, 1))
        assert len(voxels) > 0, thing.name
        assert (voxels >= np.floor(low / SIZE - 1e-6)).all(), thing.name
        assert (voxels <= np.floor(high / SIZE + 1e-6)).all(), thing.name
        if len(thing.triangles) > 3000:
            continue
        mesh = to_mesh(np.round(thing.triangles, 6))
        body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        centres = (voxels[random.integers(0, len(voxels), 20)] + 0.5) * SIZE
        _, distance, _ = trimesh.proximity.closest_point(body, centres)
        inside = centres[distance > SIZE * np.sqrt(3) / 2 + 1e-6]
        far += len(inside)
        part, closed = closed_parts(mesh)
        solids = [
            trimesh.Trimesh(mesh.vertices, mesh.faces[part == k], process=False)
            for k in np.flatnonzero(closed)
        ]
        for point in inside:
            assert any(abs(turns(solid, point)) > 0.5 for solid in solids), thing.name
    assert far > 20, "the insides of solids are filled"


def turns(body: trimesh.Trimesh, point: NDArray[np.float64]) -> float:
    """The winding number of a closed mesh around a point, by solid angles."""
    a, b, c = np.moveaxis(body.triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    top = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = (
        la * lb * lc
        + np.einsum("ij,ij->i", a, b) * lc
        + np.einsum("ij,ij->i", b, c) * la
        + np.einsum("ij,ij->i", c, a) * lb
    )
    return float(np.arctan2(top, below).sum() / (2 * np.pi))


def test_a_mirror_started_anew_is_the_same(bare_house: Engine) -> None:
    one, two = (VoxelMirror(bare_house, "house", SIZE) for _ in range(2))
    one.catch_up()
    two.catch_up()
    for number in one.names:
        first, second = (np.unique(m.regions.voxels(number), axis=0) for m in (one, two))
        assert np.array_equal(first, second)
