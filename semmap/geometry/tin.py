"""Triangles as PostGIS TINs: EWKB with a fixed stride, written and read without loops."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh

CHUNK = 1024
"""Triangles per patch: small enough for a selective index, large enough for speed."""

# OGC 06-103r4, section 8.2, with PostGIS's type codes: a TIN Z is a collection of triangles, each a
# polygon of one closed ring of four points.
_TIN_Z, _TRIANGLE_Z = 0x80000010, 0x80000011
_HEADER = np.dtype([("order", "u1"), ("type", "<u4"), ("count", "<u4")])
_TRIANGLE = np.dtype(
    [("order", "u1"), ("type", "<u4"), ("rings", "<u4"), ("points", "<u4"), ("ring", "<f8", (4, 3))]
)


def encode_chunks(
    triangles: NDArray[np.float64], size: int = CHUNK, *, keep_order: bool = False
) -> Iterator[bytes]:
    """Yield triangles (F, 3, 3), metres, as EWKB of ``TIN Z`` patches of at most `size` triangles.

    Patches are compact in space (Morton order of the triangles' centres), unless `keep_order`. Each
    is made on demand, while the database stores the one before.
    """
    sorted_ = not keep_order and len(triangles) > size
    order = morton_order(triangles) if sorted_ else np.arange(len(triangles))
    records = np.zeros(min(size, len(triangles)), dtype=_TRIANGLE)
    records["order"] = 1
    records["type"] = _TRIANGLE_Z
    records["rings"] = 1
    records["points"] = 4
    for start in range(0, len(triangles), size):
        corners = triangles[order[start : start + size]]
        part = records[: len(corners)]
        part["ring"][:, :3] = corners
        part["ring"][:, 3] = corners[:, 0]
        header = np.array([(1, _TIN_Z, len(part))], dtype=_HEADER)
        yield header.tobytes() + part.tobytes()


def decode_patch(patch: bytes) -> NDArray[np.float64]:
    """The triangles (F, 3, 3), metres, of a patch, as a view of its bytes, or ValueError."""
    order, kind, count = np.frombuffer(patch, dtype=_HEADER, count=1)[0]
    size = _HEADER.itemsize + count * _TRIANGLE.itemsize
    if order != 1 or kind != _TIN_Z or len(patch) != size:
        raise ValueError("not the EWKB of a TIN Z without SRID")
    records = np.frombuffer(patch, dtype=_TRIANGLE, offset=_HEADER.itemsize)
    triangles: NDArray[np.float64] = records["ring"][:, :3]
    return triangles


def to_mesh(triangles: NDArray[np.float64]) -> Mesh:
    """Triangles (F, 3, 3) as a mesh whose equal corners are one vertex."""
    corners = np.ascontiguousarray(triangles.reshape(-1, 3)) + 0.0  # -0.0 equals 0.0
    keys = corners.view(np.dtype((np.void, 24))).ravel()
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return Mesh(corners[first], inverse.reshape(-1, 3).astype(np.int32))


def morton_order(triangles: NDArray[np.float64]) -> NDArray[np.intp]:
    """The order of triangles along a space-filling curve through their centres."""
    centres = (triangles[:, 0] + triangles[:, 1] + triangles[:, 2]) / 3  # thrice as fast as a mean
    low = centres.min(axis=0)
    span = max(float((centres.max(axis=0) - low).max()), 1e-12)
    cells = ((centres - low) * (1023 / span)).astype(np.uint32)
    code = np.zeros(len(cells), dtype=np.uint32)
    for axis in range(3):
        v = cells[:, axis]
        v = (v | (v << 16)) & np.uint32(0x030000FF)
        v = (v | (v << 8)) & np.uint32(0x0300F00F)
        v = (v | (v << 4)) & np.uint32(0x030C30C3)
        v = (v | (v << 2)) & np.uint32(0x09249249)
        code |= v << np.uint32(axis)
    return np.argsort(code, kind="stable")
