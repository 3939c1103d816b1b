"""Texts that do not overlap: each takes the first free place of several."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
        self._shunned: list[Box] = []
        figure = axes.get_figure(root=True)
        assert figure is not None
        self._points = figure.dpi / 72
        self._renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
        x0, y0, x1, y1 = axes.get_window_extent(self._renderer).extents
        self._inside: Box = float(x0), float(y0), float(x1), float(y1)

    def keep_clear(self, x: float, y: float, radius: float) -> None:
        """Keep texts further than `radius` points from a point, in data units."""
        px, py = self.axes.transData.transform((x, y))
        r = radius * self._points
        self.taken.append((float(px - r), float(py - r), float(px + r), float(py + r)))

    def shun(self, boxes: Iterable[tuple[float, float, float, float]]) -> None:
        """Let later texts avoid these boxes, (x0, y0, x1, y1) in data units."""
        corners = (self.axes.transData.transform(np.reshape(b, (2, 2))) for b in boxes)
        self._shunned = [
            (float(x0), float(y0), float(x1), float(y1)) for (x0, y0), (x1, y1) in corners
        ]

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
        **style: Any,
    ) -> Annotation | None:
        """Write a text at the offset (right, up; points) where it overlaps least; return it.

        None where more than a share of it, `most`, overlaps there. `leader` is the style of a line
        from a moved text to its point; it has to fit `within` a (width, height), in data units.
        """
        style = {"ha": "center", "va": "center"} | style
        artist = self.axes.annotate(
            text, (x, y), xytext=(0, 0), textcoords="offset points", annotation_clip=False, **style
        )
        places = np.array([*offsets], np.float64)
        boxes = self._extent(artist) + np.tile(places * self._points, 2)
        covered = _common(boxes, self.taken)
        covered += np.maximum(_area(boxes) - _common(boxes, [self._inside]), 0.0)
        if within is not None and not self._fits(boxes[0], within):
            covered += _area(boxes)
        best = int(np.argmin(covered + 0.3 * _common(boxes, self._shunned)))
        offset, box = places[best].tolist(), boxes[best].tolist()
        if covered[best] > most * _area(boxes)[best]:
            artist.remove()
            return None
        artist.set_position(offset)
        self.taken.append(box)
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

    def _extent(self, artist: Annotation) -> NDArray[np.float64]:
        artist.update_positions(self._renderer)
        patch = artist.get_bbox_patch()
        if patch is not None:
            artist.update_bbox_position_size(self._renderer)
            box = patch.get_window_extent(self._renderer)
        else:
            box = Text.get_window_extent(artist, self._renderer)
        return np.array(box.padded(PADDING * self._points).extents)

    def _fits(self, box: NDArray[np.float64], within: tuple[float, float]) -> bool:
        (x0, y0), (x1, y1) = self.axes.transData.transform([(0, 0), within])
        return bool(box[2] - box[0] <= abs(x1 - x0) and box[3] - box[1] <= abs(y1 - y0))


def _area(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    sides = boxes[:, 2:] - boxes[:, :2]
    return np.asarray(sides[:, 0] * sides[:, 1])


def _common(boxes: NDArray[np.float64], others: Sequence[Box]) -> NDArray[np.float64]:
    """(n,) the area of each of n boxes that each of the others covers, in sum."""
    a, b = boxes[:, None], np.reshape(np.array(others, np.float64), (1, -1, 4))
    sides = np.minimum(a[..., 2:], b[..., 2:]) - np.maximum(a[..., :2], b[..., :2])
    return np.asarray(np.prod(sides.clip(min=0.0), axis=2).sum(axis=1))
