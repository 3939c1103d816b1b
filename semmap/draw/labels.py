"""Texts that do not overlap: each takes the first free place of several."""

from __future__ import annotations

import math
from collections.abc import Iterable
from math import ceil, floor
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Annotation, Text
from numpy.typing import NDArray

Offset = tuple[float, float]
Style = dict[str, Any]
Box = tuple[float, float, float, float]
"""x0, y0, x1, y1, pixels; a Bbox computes its sides each time it is asked for them."""

AROUND: tuple[Offset, ...] = tuple(
    (float(r * np.cos(a)), float(r * np.sin(a)))
    for r in (12, 20, 30, 42)
    for a in np.deg2rad((90, -90, 0, 180, 45, 135, -45, -135))
)

PADDING = 1.5
"""Around each text, points."""


class Labels:
    """The texts of a figure whose axes have their final size."""

    def __init__(self, axes: Axes) -> None:
        self.axes = axes
        self.taken: list[Box] = []
        figure = axes.get_figure(root=True)
        assert figure is not None
        self.dpi = figure.dpi
        self._points = figure.dpi / 72
        self._renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
        window = axes.get_window_extent(self._renderer)
        self._corner = np.floor(window.min)
        width, height = np.ceil(window.max - self._corner).astype(int)
        # Pixels, so that a place is judged in the same time among ten texts and ten thousand.
        self._covered = np.zeros((height, width), bool)
        self._shunned = np.zeros((height, width), bool)

    def keep_clear(self, x: float, y: float, radius: float) -> None:
        """Keep texts further than `radius` points from a point, in data units."""
        px, py = self.axes.transData.transform((x, y))
        r = radius * self._points
        self._take((float(px - r), float(py - r), float(px + r), float(py + r)))

    def shun(self, boxes: Iterable[tuple[float, float, float, float]]) -> None:
        """Let later texts avoid these boxes, (x0, y0, x1, y1) in data units."""
        self._shunned[:] = False
        for box in boxes:
            (x0, y0), (x1, y1) = self.axes.transData.transform(np.reshape(box, (2, 2)))
            self._shunned[self._pixels((x0, y0, x1, y1))] = True

    def put(
        self,
        x: float,
        y: float,
        text: str,
        *,
        offsets: Iterable[Offset] = ((0.0, 0.0),),
        most: float = 0.0,
        leader: dict[str, Any] | None = None,
        within: tuple[float, float] | None = None,
        inside: Box | None = None,
        least: float = math.inf,
        **style: Any,
    ) -> Annotation | None:
        """Write a text at the offset (right, up; points) where it overlaps least; return it.

        None where more than a share of it, `most`, overlaps there. `leader` is the style of a line
        from a moved text to its point. The text has to fit `within` a (width, height), or the size
        of a box `inside` which it should lie, (x0, y0, x1, y1), in data units. Where it does not,
        its letters become smaller, down to `least` points. A part beside the box counts as
        overlapped.
        """
        style = {"ha": "center", "va": "center"} | style
        artist = self.axes.annotate(
            text, (x, y), xytext=(0, 0), textcoords="offset points", annotation_clip=False, **style
        )
        extent = self._extent(artist)
        bounds: Box | None = None
        if inside is not None:
            within = inside[2] - inside[0], inside[3] - inside[1]
            corners = self.axes.transData.transform(np.reshape(inside, (2, 2)))
            bounds = tuple(corners.ravel().tolist())
        if within is not None and (ratio := self._ratio(extent, within)) < 1:
            size = float(artist.get_fontsize()) * ratio * 0.96  # letters are of whole pixels
            if size < least:
                artist.remove()
                return None
            artist.set_fontsize(size)
            extent = self._extent(artist)
        best, offset, box, cost = 1.0, (0.0, 0.0), extent, np.inf
        for place in offsets:
            at = _moved(extent, place, self._points)
            covered = 0.0 if bounds is None else _beside(at, bounds)
            if covered >= cost or covered > most:
                continue
            covered += self._share(self._covered, at, beyond=True)
            worth = covered + 0.3 * self._share(self._shunned, at)
            if worth < cost:
                best, offset, box, cost = covered, place, at, worth
            if cost == 0:
                break
        if best > most:
            artist.remove()
            return None
        artist.set_position(offset)
        self._take(box)
        if leader is not None and np.hypot(*offset) > 8:
            self.axes.annotate(
                "",
                (x, y),
                xytext=offset,
                textcoords="offset points",
                arrowprops={"arrowstyle": "-", "shrinkA": 0, "shrinkB": 0} | leader,
                annotation_clip=False,
            )
        return artist

    def _take(self, box: Box) -> None:
        self.taken.append(box)
        self._covered[self._pixels(box)] = True

    def _pixels(self, box: Box) -> tuple[slice, slice]:
        """The pixels of the axes that a box touches."""
        x, y = self._corner
        rows, columns = self._covered.shape
        x0, y0, x1, y1 = floor(box[0] - x), floor(box[1] - y), ceil(box[2] - x), ceil(box[3] - y)
        return slice(max(y0, 0), min(max(y1, 0), rows)), slice(max(x0, 0), min(max(x1, 0), columns))

    def _share(self, mask: NDArray[np.bool_], box: Box, *, beyond: bool = False) -> float:
        """The share of a box where the mask is set, and that lies `beyond` the axes."""
        seen = mask[self._pixels(box)]
        x0, y0, x1, y1 = floor(box[0]), floor(box[1]), ceil(box[2]), ceil(box[3])
        whole = max((x1 - x0) * (y1 - y0), 1)
        return float(np.count_nonzero(seen) + beyond * (whole - seen.size)) / whole

    def _extent(self, artist: Annotation) -> Box:
        artist.update_positions(self._renderer)
        patch = artist.get_bbox_patch()
        if patch is not None:
            artist.update_bbox_position_size(self._renderer)
            box = patch.get_window_extent(self._renderer)
        else:
            box = Text.get_window_extent(artist, self._renderer)
        x0, y0, x1, y1 = box.padded(PADDING * self._points).extents
        return float(x0), float(y0), float(x1), float(y1)

    def _ratio(self, box: Box, within: tuple[float, float]) -> float:
        """How many times as large as the box what it has to fit in is."""
        (x0, y0), (x1, y1) = self.axes.transData.transform([(0, 0), within])
        return float(min(abs(x1 - x0) / (box[2] - box[0]), abs(y1 - y0) / (box[3] - box[1])))


def _beside(box: Box, bounds: Box) -> float:
    """The share of a box that is beside another one."""
    wide = max(0.0, min(box[2], bounds[2]) - max(box[0], bounds[0]))
    high = max(0.0, min(box[3], bounds[3]) - max(box[1], bounds[1]))
    return 1 - wide * high / ((box[2] - box[0]) * (box[3] - box[1]))


def _moved(box: Box, offset: Offset, scale: float) -> Box:
    x, y = offset[0] * scale, offset[1] * scale
    return box[0] + x, box[1] + y, box[2] + x, box[3] + y
