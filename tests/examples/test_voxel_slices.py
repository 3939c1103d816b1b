"""Slices through sets: each set in its colour at its place, and the legend."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from examples.voxel_slices import VoxelSet, VoxelSlice, draw_slices, set_colour, slices_picture

COLOURS = {"mug": "#ff0000", "view": "#ffff00", "zone": "#0000ff"}
SETS = {
    3: VoxelSet(("mug",), 12),
    42: VoxelSet(("mug", "view"), 5),
    7: VoxelSet(("zone",), 1234),
}


def one_slice() -> VoxelSlice:
    numbers = np.zeros((20, 40), np.int32)
    numbers[:5, :10] = 3
    numbers[:5, 10:20] = 42
    numbers[15:, 30:] = 7
    return VoxelSlice(numbers, (-1.0, 1.0, 0.0, 1.0), "from the side", ("x", "z"), ("h", 0.5))


def test_the_colour_of_a_set_is_a_mixture() -> None:
    assert set_colour(["mug"], COLOURS) == (1.0, 0.0, 0.0)
    r, g, b = set_colour(["mug", "view"], COLOURS)
    assert (r, g, b) == pytest.approx((0.93, 0.31, 0.0))
    assert set_colour(["mug", "view"], COLOURS) != set_colour(["view", "mug"], COLOURS)
    assert len(set_colour(["unknown"], COLOURS)) == 3


def test_each_set_is_drawn_at_its_place(tmp_path: Path) -> None:
    path = slices_picture(tmp_path / "new" / "slice.png", [one_slice()], SETS, COLOURS)
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(float) / 255
    left = pixels[:, : int(0.66 * pixels.shape[1])]
    middles = {}
    for number, each in SETS.items():
        colour = np.array(set_colour(each.members, COLOURS))
        rows, columns = np.nonzero((np.abs(left - colour) < 0.02).all(axis=-1))
        assert len(rows) > 1000
        middles[number] = rows.mean(), columns.mean()
    assert middles[3][1] < middles[42][1] < middles[7][1]
    assert middles[7][0] < middles[3][0] - 200, "the lowest row is at the bottom"


def test_the_legend_lists_sets_events_and_relations() -> None:
    figure = Figure()
    events = [f"mug on table{i} begins" for i in range(30)]
    for _ in range(2):  # the second drawing replaces the first
        draw_slices(figure, [one_slice(), one_slice()], SETS, COLOURS, title="step", events=events)
    assert len(figure.axes) == 3
    texts = [text.get_text() for text in figure.axes[-1].texts]
    assert texts[0] == "3 sets"
    assert texts[1:3] == ["mug + view", "5"], "most members first"
    assert "1,234" in texts
    assert "and 23 more" in texts
    assert texts[-1] == "nothing"
    swatches = [p for p in figure.axes[-1].patches if isinstance(p, Rectangle)]
    assert swatches[0].get_facecolor()[:3] == pytest.approx(set_colour(["mug", "view"], COLOURS))


def test_no_sets_give_an_empty_legend() -> None:
    figure = Figure()
    empty = VoxelSlice(np.zeros((2, 2), np.int32), (0, 1, 0, 1), "", ("x", "y"))
    draw_slices(figure, [empty], {}, {})
    assert figure.axes[-1].texts[0].get_text() == "0 sets"
