"""Meshes out of the database, as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray
from sqlalchemy import Connection, text

from semmap.geometry.pose import Pose
from semmap.geometry.tin import decode

__all__ = ["model_triangles", "world_triangles"]


def model_triangles(connection: psycopg.Connection[Any], model_id: int) -> NDArray[np.float64]:
    """The triangles of a model in its own frame, (F, 3, 3) metres, in the order of its chunks."""
    with connection.cursor(binary=True) as cursor:
        cursor.execute(
            "SELECT geom::bytea FROM semmap.chunk WHERE model_id = %s ORDER BY number", (model_id,)
        )
        return decode([row[0] for row in cursor.fetchall()])


def world_triangles(
    connection: Connection, entity_ids: list[int]
) -> dict[int, NDArray[np.float64]]:
    """The triangles of entities in the map's frame, (F, 3, 3) metres; without geometry: none.

    Each model is read once, however many instances it has.
    """
    rows = connection.execute(
        text(
            "SELECT DISTINCT ec.entity_id, c.model_id, w.pose FROM entity_chunk ec "
            "JOIN chunk c ON c.id = ec.chunk_id JOIN world w ON w.entity_id = ec.entity_id "
            "WHERE ec.entity_id = ANY(:ids) AND ST_Dimension(c.geom) = 2 ORDER BY 1, 2"
        ),
        {"ids": entity_ids},
    ).all()
    driver = connection.connection.driver_connection
    assert driver is not None
    models = {
        model_id: model_triangles(driver, model_id) for model_id in {row.model_id for row in rows}
    }
    parts: dict[int, list[NDArray[np.float64]]] = {}
    for entity_id, model_id, pose in rows:
        placed = Pose(*pose).apply(models[model_id].reshape(-1, 3)).reshape(-1, 3, 3)
        parts.setdefault(entity_id, []).append(placed)
    return {entity_id: np.concatenate(p) for entity_id, p in parts.items()}
