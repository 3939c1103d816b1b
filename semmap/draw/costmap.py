"""Costmaps in the colours of costmap_2d, as RViz shows them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon as Patch
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from semmap.draw.sheet import draw_title, save_sheet

_LETHAL, _INSCRIBED, _UNKNOWN = 254, 253, 255

LEGEND = {
    0: "free",
    80: "near",
    _INSCRIBED - 1: "nearer",
    _INSCRIBED: "the robot touches",
    _LETHAL: "occupied",
    _UNKNOWN: "unknown",
}
"""What costs mean."""

LONGER_SIDE = 11.0
"""Of a picture, inches."""


def colours(costs: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The RGB that RViz gives costs of costmap_2d, (..., 3) uint8: free white, lethal purple."""
    share = np.arange(256) / 252
    table = 255 * np.column_stack([share, np.zeros(256), 1 - share])
    # Low costs fade into white, so that their border shows no edge.
    fade = np.clip(np.arange(256) / 60, 0, 1)[:, None]
    table = 255 * (1 - fade) + table * fade
    table[0] = (255, 255, 255)
    table[_INSCRIBED] = (0, 255, 255)
    table[_LETHAL] = (200, 0, 200)
    table[_UNKNOWN] = (112, 137, 134)
    found: NDArray[np.uint8] = table.clip(0, 255).astype(np.uint8)[costs]
    return found


def costmap_picture(
    costs: NDArray[np.uint8],
    origin: tuple[float, float],
    resolution: float,
    path: Path | str,
    *,
    title: str = "",
    lines: Sequence[tuple[NDArray[np.float64], str]] = (),
    footprints: Sequence[tuple[NDArray[np.float64], str]] = (),
) -> Path:
    """Draw a costmap and save it as PNG; return the path of the picture.

    Row 0 of `costs` is the lowest y; `origin` is the lower left corner. Lines are (N, 2) points and
    footprints (N, 2) corners, each with a colour; all in metres.
    """
    rows, columns = costs.shape
    width = LONGER_SIDE * min(1, columns / rows)
    height = width * rows / columns
    whole = height + 0.45 + 0.3
    figure = Figure(figsize=(width, whole), dpi=150)
    axes = figure.add_axes((0, 0.3 / whole, 1, height / whole))
    x, y = origin
    extent = (x, x + columns * resolution, y, y + rows * resolution)
    axes.imshow(colours(costs), origin="lower", extent=extent, interpolation="nearest")
    for points, colour in lines:
        for shade, wide in (("white", 3.4), (colour, 1.8)):
            axes.plot(*points[:, :2].T, color=shade, lw=wide, solid_capstyle="round")
    for corners, colour in footprints:
        axes.add_patch(Patch(corners, closed=True, fc=(*to_rgb(colour), 0.25), ec=colour, lw=1.6))
    axes.set_axis_off()
    axes.set_xlim(extent[:2])
    axes.set_ylim(extent[2:])
    draw_title(figure, title, 1 - 0.22 / whole, 12, left=0.01, right=0.99)
    shades = colours(np.array([*LEGEND], np.uint8)) / 255
    signs = [
        Rectangle((0, 0), 1, 1, fc=shade, ec="#6b6f76", lw=0.4, label=meaning)
        for shade, meaning in zip(shades, LEGEND.values(), strict=True)
    ]
    small: dict[str, Any] = {"fontsize": 7, "handlelength": 1.2, "columnspacing": 1.2}
    figure.legend(handles=signs, loc="lower center", ncols=len(signs), frameon=False, **small)
    return save_sheet(figure, path)
