"""Titles of pictures, as large as the picture is wide."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.text import Text

from semmap.draw.palette import INK


def draw_title(
    figure: Figure, title: str, y: float, size: float, left: float = 0.025, right: float = 0.975
) -> Text:
    """Draw a bold title of `size` points, or smaller where it would reach over `right`.

    `y` of its middle, `left` and `right` are parts of the figure's height and width.
    """
    text = figure.text(left, y, title, fontsize=size, weight="bold", color=INK, va="center")
    width = text.get_window_extent().width
    room = (right - left) * figure.bbox.width
    if width > room:
        text.set_fontsize(size * room / width)
    return text
