"""Fields as files, read back by another program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from semmap.fields import Sphere
from semmap.fields.maps.export import write_grid, write_points
from semmap.fields.maps.grids import Grid
from semmap_vdb import BoolGrid, FloatGrid, Int32Grid

GRIDS = ((BoolGrid, True, "u1"), (Int32Grid, -7, "<i4"), (FloatGrid, 2.5, "<f4"))


def turned(kind: type, value: object) -> Grid:
    """A ball of 0.5 m at (3, 0, 0), in a frame that is turned and moved."""
    grid: Grid = kind(0.05, False)
    grid.fill(Sphere((3, 0, 0), 0.5).shape, value)  # type: ignore[arg-type]
    turn = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    grid.place(np.column_stack([turn, (0, 0, 1)]).tolist())
    return grid


@pytest.mark.parametrize(("kind", "value", "dtype"), GRIDS)
def test_points_of_a_grid(tmp_path: Path, kind: type, value: object, dtype: str) -> None:
    grid = turned(kind, value)
    write_grid(tmp_path / "ball.ply", grid, "ball")
    cloud: Any = trimesh.load(tmp_path / "ball.ply")
    assert len(cloud.vertices) == len(grid)
    assert np.linalg.norm(cloud.vertices - (0, 3, 1), axis=1).max() <= 0.5 + 1e-6
    assert (grid.at(cloud.vertices) == value).all()
    data = (tmp_path / "ball.ply").read_bytes()
    body = data[data.index(b"end_header\n") + 11 :]
    row = np.dtype([("at", "<f4", 3), ("rgb", "u1", 3), ("value", dtype)])
    rows = np.frombuffer(body, row)
    assert (rows["value"] == value).all()
    assert len(np.unique(rows["rgb"], axis=0)) == 1


def test_numbers_have_a_ramp(tmp_path: Path) -> None:
    values = np.array([0, 1, 2, np.nan, np.inf], np.float32)
    write_points(tmp_path / "ramp.ply", np.eye(5, 3), values, name="cost")
    assert b"property float cost\n" in (tmp_path / "ramp.ply").read_bytes()
    cloud: Any = trimesh.load(tmp_path / "ramp.ply")
    assert np.asarray(cloud.colors)[:, :3].tolist() == [
        [68, 1, 84],
        [33, 145, 140],
        [253, 231, 37],
        [150, 150, 150],
        [150, 150, 150],
    ]


def test_an_empty_grid_is_a_file_without_points(tmp_path: Path) -> None:
    write_grid(tmp_path / "none.ply", FloatGrid(0.1, 0.0), "none")
    assert b"element vertex 0\n" in (tmp_path / "none.ply").read_bytes()


def test_vdb(tmp_path: Path) -> None:
    write_grid(tmp_path / "ball.vdb", turned(FloatGrid, 2.5), "cost")
    data = (tmp_path / "ball.vdb").read_bytes()
    assert data[:4] == b" BDV"
    assert b"cost" in data


def test_an_unknown_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"cloud.xyz has an unknown ending: .* \.vdb or \.ply"):
        write_grid(tmp_path / "cloud.xyz", BoolGrid(0.1, False), "x")
    assert not list(tmp_path.iterdir())
