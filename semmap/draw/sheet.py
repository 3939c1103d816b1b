"""The sheets of pictures: paper, titles as large as they fit, PNG files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray

from semmap.draw.palette import INK, PAPER
from semmap.terminal import visible
from semmap.whole_file import whole_file


def paper_sheet(width: float, height: float, dpi: int) -> Figure:
    """Return a figure in inches whose texts can be measured."""
    figure = Figure(figsize=(width, height), dpi=dpi, facecolor=PAPER)
    FigureCanvasAgg(figure)
    return figure


def rendered_sheet(
    picture: NDArray[np.floating[Any]], dpi: int, head: int = 0
) -> tuple[Figure, Axes]:
    """Return a figure of sRGB pixels (height, width, 3) in 0..1 under free ones, and its axes."""
    height, width = picture.shape[:2]
    figure = paper_sheet(width / dpi, (height + head) / dpi, dpi)
    axes = figure.add_axes((0, 0, 1, height / (height + head)))
    axes.axis("off")
    levels = np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)
    figure.figimage(levels, origin="upper", zorder=-1)  # not resampled, as by axes
    return figure, axes


def save_sheet(figure: Figure, path: Path | str) -> Path:
    """Save a figure in a folder that is made where it is missing; return the file."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as made:
        figure.savefig(made)
    return path


def draw_title(
    figure: Figure, title: str, y: float, size: float, left: float = 0.025, right: float = 0.975
) -> Text:
    """Draw a bold title of at most `size` points from `left` to `right`, parts of the width."""
    text = figure.text(
        left, y, visible(title), fontsize=size, weight="bold", color=INK, va="center"
    )
    width = text.get_window_extent().width
    room = (right - left) * figure.bbox.width
    if width > room:
        text.set_fontsize(size * room / width)
    return text
