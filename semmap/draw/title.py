"""Titles of pictures, as large as the picture is wide."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.text import Text

__all__ = ["draw_title"]


def draw_title(figure: Figure, title: str, y: float, size: float, margin: float = 0.025) -> Text:
    """Draw a title in bold at the left; one that is too long for the figure is made smaller.

    Parameters
    ----------
    figure : Figure
    title : str
    y : float
        Of its middle, as a part of the figure's height.
    size : float
        Of the font at most, points.
    margin : float
        On both sides, as a part of the figure's width.
    """
    text = figure.text(margin, y, title, fontsize=size, weight="bold", va="center")
    width = text.get_window_extent().width
    room = (1 - 2 * margin) * figure.bbox.width
    if width > room:
        text.set_fontsize(size * room / width)
    return text
