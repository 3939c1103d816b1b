"""Costmaps as pictures: the colours of costmap_2d, the lowest row at the bottom."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from semmap.draw.costmap import colours, costmap_picture


def test_each_cost_has_its_colour() -> None:
    table = colours(np.arange(256, dtype=np.uint8))
    assert table[0].tolist() == [255, 255, 255]
    assert table[253].tolist() == [0, 255, 255]
    assert table[254].tolist() == [200, 0, 200]
    assert table[255].tolist() == [112, 137, 134]
    falling = table[60:253].astype(int)
    assert (np.diff(falling[:, 0]) >= 0).all(), "red rises"
    assert (np.diff(falling[:, 2]) <= 0).all(), "blue falls"
    assert len(np.unique(table[[0, 100, 253, 254, 255]], axis=0)) == 5


def test_the_lowest_row_is_at_the_bottom(tmp_path: Path) -> None:
    costs = np.zeros((20, 30), np.uint8)
    costs[:5, :10] = 254
    path = costmap_picture(costs, (0.0, 0.0), 0.1, tmp_path / "costs.png")
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)[:-45]  # above the legend
    purple = np.abs(pixels - (200, 0, 200)).sum(axis=-1) < 10
    rows, columns = np.nonzero(purple)
    height, width = purple.shape
    assert rows.min() > height * 0.7
    assert columns.max() < width * 0.4


def test_paths_and_footprints_are_drawn(tmp_path: Path) -> None:
    costs = np.zeros((20, 30), np.uint8)
    square = np.array([[1, 1], [2, 1], [2, 1.5], [1, 1.5]])
    path = costmap_picture(
        costs,
        (0.0, 0.0),
        0.1,
        tmp_path / "way.png",
        lines=[(np.array([[0.2, 0.2], [2.8, 0.2]]), "#ff0000")],
        footprints=[(square, "#00ff00")],
    )
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)
    for colour in ((255, 0, 0), (0, 255, 0)):
        assert (np.abs(pixels - colour).sum(axis=-1) < 30).sum() > 200
