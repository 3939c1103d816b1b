"""A triangle as glTF."""

from __future__ import annotations

from typing import Any

import numpy as np

BIN = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32).tobytes() + bytes(100_000)
"""A triangle, then zeros."""


def triangle(buffers: list[Any], **changes: object) -> dict[str, object]:
    """Return a document with the triangle of `BIN`, placed once."""
    return {
        "asset": {"version": "2.0"},
        "buffers": buffers,
        "bufferViews": [{"buffer": 0, "byteLength": len(BIN)}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    } | changes
