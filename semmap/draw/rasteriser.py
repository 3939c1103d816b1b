"""A z-buffer in NumPy: the triangle that each pixel shows.

A fragment is one number with the depth in its upper bits and the triangle in its lower bits.

Why: docs/decisions/3d_pictures_come_from_a_software_renderer_of_our_own_not_from_pyvista.md
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from semmap.arrays import Floats

_DEPTH_BITS, _FACE_BITS = 31, 32
_FRAGMENTS_AT_ONCE = 4_000_000


class Projection(Protocol):
    """Projects points (..., 3) to pixels from left and top and a depth, linear on a triangle."""

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture, pixels."""

    def project(self, points: Floats) -> Floats:
        """Return (..., 3); the depth is larger where a point is nearer."""


@dataclass(frozen=True)
class Camera:
    """A parallel projection; right, up and back (to the eye) are unit vectors of the map."""

    right: Floats
    up: Floats
    back: Floats
    centre: Floats  # (2,) of the picture, along right and up, metres
    scale: float  # pixels per metre
    size: tuple[int, int]  # (width, height), pixels

    @classmethod
    def look(
        cls, azimuth: float, elevation: float, points: Floats, width: int, margin: float = 0.03
    ) -> Camera:
        """Return the camera that sees all points (N, 3) from the direction of the eye.

        The azimuth is from +x, the elevation from the ground, radians; a share `margin` of the
        width (pixels) stays free on each side.
        """
        ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
        right = np.array([-sa, ca, 0.0])
        up = np.array([-ca * se, -sa * se, ce])
        back = np.array([ca * ce, sa * ce, se])
        flat = np.stack([points @ right, points @ up], axis=1)
        low, high = flat.min(axis=0), flat.max(axis=0)
        extent = np.maximum(high - low, 1e-9)
        scale = width * (1 - 2 * margin) / extent[0]
        height = int(np.ceil(extent[1] * scale + 2 * margin * width))
        return cls(right, up, back, (low + high) / 2, float(scale), (width, height))

    def window(self, left: int, top: int, width: int, height: int) -> Camera:
        """Return the camera of a part of the picture; lengths in pixels."""
        x = (left + width / 2 - self.size[0] / 2) / self.scale
        y = (self.size[1] / 2 - top - height / 2) / self.scale
        return replace(self, centre=self.centre + np.array([x, y]), size=(width, height))

    def project(self, points: Floats) -> Floats:
        """Return (..., 3) pixels from the left, pixels from the top, and metres towards the eye."""
        width, height = self.size
        x = (points @ self.right - self.centre[0]) * self.scale + width / 2
        y = height / 2 - (points @ self.up - self.centre[1]) * self.scale
        return np.stack([x, y, points @ self.back], axis=-1)


def nearest_triangles(
    camera: Projection, triangles: Floats, cut: Floats | None = None
) -> tuple[NDArray[np.int32], Floats]:
    """Return the triangle that each pixel shows, -1 for none, and its depth, -inf for none.

    Both sides of triangles (F, 3, 3) are seen. With a `Camera`, `cut` (F,) is the height above
    which a triangle is cut away, inf for none, and depths are metres towards the eye.
    """
    width, height = camera.size
    buffer = np.full(width * height, -1, np.int64)
    if len(triangles) == 0:
        return buffer.astype(np.int32).reshape(height, width), np.full((height, width), -np.inf)
    corners = camera.project(triangles)
    near, far = float(corners[..., 2].max()), float(corners[..., 2].min())
    steps = (2**_DEPTH_BITS - 2) / max(near - far, 1e-9)
    planes, flat = _depth_planes(corners)
    top = np.clip(np.ceil(corners[..., 1].min(axis=1) - 0.5), 0, height).astype(np.int64)
    bottom = np.clip(np.floor(corners[..., 1].max(axis=1) - 0.5), -1, height - 1).astype(np.int64)
    rows = np.where(flat, 0, np.maximum(bottom - top + 1, 0))

    wide = np.clip(np.ptp(corners[..., 0], axis=1), 1, width)
    load = np.cumsum(rows * wide)
    for part in np.split(
        np.arange(len(triangles)),
        np.searchsorted(load, np.arange(_FRAGMENTS_AT_ONCE, load[-1], _FRAGMENTS_AT_ONCE)),
    ):
        face, row = _expand(part, rows[part], top[part])
        face, x, y = _spans(corners, face, row, width)
        depth = planes[face, 0] * x + planes[face, 1] * y + planes[face, 2]
        if cut is not None and isinstance(camera, Camera):
            along_up = (camera.size[1] / 2 - y) / camera.scale + camera.centre[1]
            z = along_up * camera.up[2] + depth * camera.back[2]  # `right` is level
            kept = z <= cut[face]
            face, x, y, depth = face[kept], x[kept], y[kept], depth[kept]
        level = np.clip((depth - far) * steps, 0, 2**_DEPTH_BITS - 2).astype(np.int64)
        key = (level << _FACE_BITS) | face
        pixel = y.astype(np.int64) * width + x.astype(np.int64)
        np.maximum.at(buffer, pixel, key)

    seen = buffer >= 0
    faces = np.where(seen, buffer & (2**_FACE_BITS - 1), -1)
    depths = np.where(seen, (buffer >> _FACE_BITS) / steps + far, -np.inf)
    return faces.astype(np.int32).reshape(height, width), depths.reshape(height, width)


def _depth_planes(corners: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """(F, 3) a, b, c with depth = a x + b y + c, and (F,) True for triangles seen edge on."""
    (x0, y0, d0), (x1, y1, d1), (x2, y2, d2) = (corners[:, i].T for i in range(3))
    twice = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    flat = np.abs(twice) < 1e-9
    twice = np.where(flat, 1.0, twice)
    a = ((d1 - d0) * (y2 - y0) - (d2 - d0) * (y1 - y0)) / twice
    b = ((x1 - x0) * (d2 - d0) - (x2 - x0) * (d1 - d0)) / twice
    return np.stack([a, b, d0 - a * x0 - b * y0], axis=1), flat


def _expand(
    items: NDArray[np.int64], counts: NDArray[np.int64], first: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Each item repeated `counts` times, with the numbers that follow its `first`."""
    owner = np.repeat(items, counts)
    start = np.repeat(np.cumsum(counts) - counts, counts)
    return owner, np.repeat(first, counts) + np.arange(len(owner)) - start


def _spans(
    corners: Floats, face: NDArray[np.int64], row: NDArray[np.int64], width: int
) -> tuple[NDArray[np.int64], NDArray[Any], NDArray[Any]]:
    """The pixels of triangles on rows: the triangle, and x and y of the pixel's centre."""
    y = row + 0.5
    left, right = np.full(len(face), np.inf), np.full(len(face), -np.inf)
    for i in range(3):
        a, b = corners[face, i], corners[face, (i + 1) % 3]
        rise = b[:, 1] - a[:, 1]
        crossed = (np.minimum(a[:, 1], b[:, 1]) <= y) & (y <= np.maximum(a[:, 1], b[:, 1]))
        crossed &= rise != 0
        t = (y - a[:, 1]) / np.where(rise == 0, 1.0, rise)
        x = a[:, 0] + t * (b[:, 0] - a[:, 0])
        left = np.where(crossed, np.minimum(left, x), left)
        right = np.where(crossed, np.maximum(right, x), right)
    reached = left <= right
    face, y, left, right = face[reached], y[reached], left[reached], right[reached]
    first = np.clip(np.ceil(left - 0.5), 0, width).astype(np.int64)
    last = np.clip(np.floor(right - 0.5), -1, width - 1).astype(np.int64)
    counts = np.maximum(last - first + 1, 0)
    span, column = _expand(np.arange(len(face)), counts, first)
    return face[span], column + 0.5, y[span]


def quarters(image: NDArray[Any]) -> NDArray[Any]:
    """(4, height / 2, width / 2, ...): the four pixels of each square of 2 x 2."""
    return np.stack([image[i::2, j::2] for i in (0, 1) for j in (0, 1)])
