"""OctoMap files beside the reader and the writer of OctoMap itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import octomap
import pytest
import trimesh
from numpy.typing import NDArray

from navgrid.grid import Grid
from navgrid.slabs import occupancy
from semmap.ingest.meshes.mesh_file import read_mesh, read_mesh_world
from semmap.ingest.meshes.mesh_size import MeshFileError

RESOLUTION = 0.1


def written(path: Path, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Write the voxels that contain points with OctoMap; return their middles as it reads them."""
    tree = octomap.OcTree(RESOLUTION)
    for point in points[:5] + 0.3:
        tree.updateNode(point, False)
    for point in points:
        tree.updateNode(point, True)
    tree.updateInnerOccupancy()
    assert (tree.writeBinary if path.suffix == ".bt" else tree.write)(str(path).encode())
    found, _ = tree.extractPointCloud()
    return np.asarray(found)


@pytest.mark.parametrize("ending", [".bt", ".ot"])
@pytest.mark.parametrize("seed", range(4))
def test_the_surface_encloses_the_voxels_that_octomap_reads(
    tmp_path: Path, ending: str, seed: int
) -> None:
    random = np.random.default_rng(seed)
    block = np.stack(np.meshgrid(*[np.arange(-0.75, 0.8, 0.1)] * 3), axis=-1).reshape(-1, 3)
    points = np.concatenate([random.uniform(-3, 3, (60, 3)), block if seed % 2 else block[:1]])
    middles = written(tmp_path / f"scan{ending}", points)
    mesh = read_mesh(tmp_path / f"scan{ending}")
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.volume == pytest.approx(len(middles) * RESOLUTION**3)
    assert solid.contains(middles).all()
    assert np.allclose(mesh.bounds[0], middles.min(axis=0) - RESOLUTION / 2)
    assert np.allclose(mesh.bounds[1], middles.max(axis=0) + RESOLUTION / 2)


def test_a_grid_has_the_cells_of_each_voxel(tmp_path: Path) -> None:
    middles = written(tmp_path / "scan.bt", np.random.default_rng(7).uniform(0, 2, (80, 3)))
    mesh = read_mesh(tmp_path / "scan.bt")
    grid = Grid((0.0, 0.0), 0.05, (40, 40))
    cells = occupancy((mesh.vertices, mesh.faces), [(0.42, 0.58)], grid)[0]
    height = (middles[:, 2] > 0.37) & (middles[:, 2] < 0.63)
    for x, y, _ in middles[height]:
        row, column = round((y - 0.05) / 0.05), round((x - 0.05) / 0.05)
        assert cells[row : row + 2, column : column + 2].all()
    assert cells.sum() >= 4


def test_it_is_one_object(tmp_path: Path) -> None:
    written(tmp_path / "attic.bt", np.array([[1.0, 2.0, 0.5]]))
    (entry,) = read_mesh_world(tmp_path / "attic.bt").entries
    assert (entry.name, entry.kind) == ("attic", "object")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda b: b[:-3], "ends before its last node"),
        (lambda b: b.replace(b"# Octomap", b"# Oktomap"), "does not begin with"),
        (lambda b: b.replace(b"id OcTree", b"id ColorOcTree"), "only OcTree is read"),
        (lambda b: b.replace(b"res 0.1", b"res -1.0"), "resolution is -1.0"),
        (lambda b: b.split(b"size")[0] + b"res 0.1\ndata\n", "size -1"),
        (lambda b: b.split(b"data\n")[0] + b"data\n" + b"\xff" * 99, "deeper than 16|ends before"),
        (lambda b: b.split(b"data\n")[0] + b"data\n" + b"\x02\0", "may have .* triangles"),
    ],
)
def test_what_is_damaged_is_refused(tmp_path: Path, change: object, message: str) -> None:
    written(tmp_path / "good.bt", np.random.default_rng(1).uniform(-1, 1, (20, 3)))
    assert callable(change)
    (tmp_path / "bad.bt").write_bytes(change((tmp_path / "good.bt").read_bytes()))
    with pytest.raises(MeshFileError, match=message):
        read_mesh(tmp_path / "bad.bt")
