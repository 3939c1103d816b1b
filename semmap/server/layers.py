"""Layers of the viewer: costs of robots on the floors, past poses, voxels of fields, and grasps."""

from __future__ import annotations

import base64
from datetime import datetime
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from semmap.api.map import Map
from semmap.error import InvalidArgumentError
from semmap.server.calls import FILE

Bytes = NDArray[np.uint8]

OCCUPIED = (40, 48, 64, 200)
"""RGBA."""

MOST_VOXELS = 50_000
"""The most rows of fields that a page draws."""

MOST_GRASPS = 20

MOST_MOMENTS = 1000
"""Of the latest changes, those that a page can go back to."""


def costs_of(map: Map, robot: str | None = None, parts: bool = False) -> list[dict[str, Any]]:
    """The costs of a robot on each storey, in RViz's colours; without one, the occupied cells.

    Each has its `storey`, the `level` of its floor, `low` and `high` corners (x, y), metres, and a
    PNG in base64 whose first row is the highest y; what is free is transparent. With `parts` it is
    that of one `part` of the robot, `height` metres above the floor.
    """
    if robot is not None and FILE.search(robot):
        raise InvalidArgumentError(f"robot is {robot}: give the name of one in the map")
    if robot is None:
        return [_layer(grid, _occupied(grid.cells)) for grid in map.grids()]
    found = map.costmaps(robot)
    if not parts:
        return [_layer(costmap, _coloured(costmap.master)) for costmap in found]
    return [
        _layer(costmap, _coloured(costs), part=part.name, height=sum(part.interval) / 2)
        for costmap in found
        for part, costs in zip(costmap.parts, costmap.costs, strict=True)
    ]


def _layer(of: Any, pixels: Bytes, **about: Any) -> dict[str, Any]:
    grid = of.grid
    return {
        "storey": of.scene.storey,
        "level": of.scene.elevation,
        "low": list(grid.origin),
        "high": [
            start + count * grid.resolution
            for start, count in zip(grid.origin, grid.shape[::-1], strict=True)
        ],
        "png": _png(pixels[::-1]),
        **about,
    }


def moments_of(map: Map) -> list[str]:
    """The times of the latest changes, the first one first."""
    rows = map.execute(
        "SELECT at FROM (SELECT DISTINCT at FROM change WHERE map_id = current_map() "
        "ORDER BY at DESC LIMIT %s) c ORDER BY at",
        MOST_MOMENTS,
    )
    return [str(at) for (at,) in rows]  # as events have it


def poses_of(map: Map, at: str) -> dict[str, dict[str, list[float] | None]]:
    """The pose of each object and agent at a time, in the map's frame; None where it was not."""
    try:
        moment = datetime.fromisoformat(at)
    except ValueError as error:
        raise InvalidArgumentError(f"at is {at!r}: give a time as 2026-01-31T12:00:00Z") from error
    rows = map.execute(
        "SELECT name, pose_at(id, %s) FROM entity "
        "WHERE map_id = current_map() AND kind IN ('object', 'agent')",
        moment.astimezone(),
    )
    return {"poses": dict(rows)}


def voxels_of(map: Map, text: str) -> dict[str, Any]:
    """The voxels that answer a query of docs/fields_language.md, and the names in the answer.

    `size` is the edge of a voxel, `sets` has the other values of its row and `centres` (N, 3) for
    each of them, metres; `total` counts all rows, of which the first `MOST_VOXELS` are there.
    """
    answer = map.fields.query(text, limit=MOST_VOXELS)
    sets: dict[str, list[list[float]]] = {}
    names: set[str] = set()
    for row in answer.rows:
        others = [value for value in row if not isinstance(value, tuple)]
        names.update(value for value in others if isinstance(value, str))
        centres = [[round(x, 4) for x in value] for value in row if isinstance(value, tuple)]
        if centres:
            sets.setdefault(" ".join(str(each) for each in others), []).extend(centres)
    return {
        "size": map.fields.voxel_size,
        "sets": [{"of": of, "centres": centres} for of, centres in sets.items()],
        "names": sorted(names),
        "total": answer.total,
        "truth": answer.truth,
        "left_out": list(answer.left_out),
    }


def grasps_of(map: Map, name: str) -> list[dict[str, Any]]:
    """The best stored grasps of an object: `pose` (map's frame), `width` (metres), `expected`."""
    found = map.grasps(name, stored=True, check=False, limit=MOST_GRASPS)
    return [{key: row[key] for key in ("pose", "width", "expected")} for row in found]


def _occupied(cells: NDArray[np.int8]) -> Bytes:
    return np.where((cells == 100)[..., None], np.array(OCCUPIED, np.uint8), np.uint8(0))


def _coloured(costs: Bytes) -> Bytes:
    from semmap.draw.costmap import colours  # loads matplotlib

    known = (costs > 0) & (costs < 255)
    return np.dstack([colours(costs), np.where(known, 190, 0).astype(np.uint8)])


def _png(pixels: Bytes) -> str:
    file = BytesIO()
    Image.fromarray(pixels, "RGBA").save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode()
