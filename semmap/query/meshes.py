"""Meshes out of the database, as arrays."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray

from semmap.geometry.pose import Pose
from semmap.geometry.tin import decode_patch


def model_triangles(connection: psycopg.Connection[Any], model_id: int) -> NDArray[np.float64]:
    """The triangles of a model in its own frame, (F, 3, 3) metres, in the order of its chunks."""
    return models_triangles(connection, [model_id]).get(model_id, np.empty((0, 3, 3)))


def models_triangles(
    connection: psycopg.Connection[Any], model_ids: Iterable[int]
) -> dict[int, NDArray[np.float64]]:
    """The triangles of several models, as `model_triangles`, in one round; of no faces: none."""
    ids = [*model_ids]
    sizes = connection.execute(
        "SELECT id, triangles FROM semmap.model WHERE id = ANY(%s) AND triangles > 0", (ids,)
    ).fetchall()
    found = {model_id: np.empty((count, 3, 3)) for model_id, count in sizes}
    filled = dict.fromkeys(found, 0)
    # COPY hands over a patch at a time: a result of the whole would be kept twice.
    with connection.cursor().copy(
        "COPY (SELECT model_id, geom::bytea FROM semmap.chunk WHERE model_id = ANY(%s) "
        "ORDER BY model_id, number) TO STDOUT (FORMAT BINARY)",
        ([*found],),
    ) as copy:
        copy.set_types(["int8", "bytea"])
        for model_id, patch in copy.rows():
            part = decode_patch(patch)
            start = filled[model_id]
            found[model_id][start : start + len(part)] = part
            filled[model_id] += len(part)
    return found


def models_points(
    connection: psycopg.Connection[Any], model_ids: Iterable[int]
) -> dict[int, NDArray[np.float64]]:
    """The points of several point clouds in their own frames, (N, 3) metres."""
    rows = connection.execute(
        "SELECT c.model_id, public.ST_AsBinary(c.geom) FROM semmap.chunk c "
        "JOIN semmap.model m ON m.id = c.model_id "
        "WHERE m.kind = 'cloud' AND m.id = ANY(%s) ORDER BY c.model_id, c.number",
        ([*model_ids],),
    ).fetchall()
    parts: dict[int, list[NDArray[np.float64]]] = {}
    for model_id, chunk in rows:
        points = shapely.get_coordinates(shapely.from_wkb(bytes(chunk)), include_z=True)
        parts.setdefault(model_id, []).append(points)
    return {model_id: np.concatenate(found) for model_id, found in parts.items()}


def world_triangles(
    connection: psycopg.Connection[Any], entity_ids: list[int]
) -> dict[int, NDArray[np.float64]]:
    """The triangles of entities in the map's frame, (F, 3, 3) metres, each model read once."""
    rows = connection.execute(
        "SELECT DISTINCT ec.entity_id, c.model_id, w.pose FROM entity_chunk ec "
        "JOIN chunk c ON c.id = ec.chunk_id JOIN world w ON w.entity_id = ec.entity_id "
        "JOIN model m ON m.id = c.model_id AND m.triangles > 0 "
        "WHERE ec.entity_id = ANY(%s) ORDER BY 1, 2",
        (entity_ids,),
    ).fetchall()
    models = models_triangles(connection, {model_id for _, model_id, _ in rows})
    parts: dict[int, list[NDArray[np.float64]]] = {}
    for entity_id, model_id, pose in rows:
        placed = Pose(*pose).apply(models[model_id].reshape(-1, 3)).reshape(-1, 3, 3)
        parts.setdefault(entity_id, []).append(placed)
    return {entity_id: np.concatenate(p) for entity_id, p in parts.items()}
