"""Geometric models into the database: each once, its triangles as chunks."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray
from psycopg import sql

from semmap.geometry.ground_outline import ground_outline
from semmap.geometry.outline import hull_points
from semmap.geometry.tin import encode_chunks
from semmap.ingest.store.copy_rows import copy_statement, writable_table
from semmap.ingest.world import Entry, Shape

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, the amount done, and the total amount."""


def shape_digest(shape: Shape) -> str:
    """Return a hash of a shape's content: equal shapes are stored once."""
    h = hashlib.sha256(shape.kind.encode())
    if shape.mesh is not None:
        h.update(shape.mesh.digest().encode())
    if shape.outline is not None:
        h.update(shapely.to_wkb(shape.outline))
    return h.hexdigest()


def store_models(
    cursor: psycopg.Cursor[Any], entries: Sequence[Entry], progress: Progress
) -> tuple[dict[int, int], int]:
    """Store the new models; return all model ids by ``id(shape)``, and how many are new."""
    digests: dict[int, str] = {}
    shapes: dict[str, Shape] = {}
    cache: dict[tuple[str, int, int], str] = {}
    for entry in entries:
        for shape in entry.shapes:
            key = (shape.kind, id(shape.mesh), id(shape.outline))
            digest = cache.get(key) or cache.setdefault(key, shape_digest(shape))
            digests[id(shape)] = digest
            shapes.setdefault(digest, shape)
    cursor.execute("SELECT digest, id FROM model WHERE digest = ANY(%s)", (list(shapes),))
    ids: dict[str, int] = dict(cursor.fetchall())
    new = [(d, s) for d, s in shapes.items() if d not in ids]
    total = sum(len(s.mesh.faces) for _, s in new if s.mesh is not None)
    done = 0
    for digest, shape in new:
        ids[digest] = _insert_model(cursor, digest, shape)
        done += 0 if shape.mesh is None else len(shape.mesh.faces)
        progress("triangles", done, total)
    return {key: ids[digest] for key, digest in digests.items()}, len(new)


def _insert_model(cursor: psycopg.Cursor[Any], digest: str, shape: Shape) -> int:
    mesh, outline, is_cloud = shape.mesh, shape.outline, shape.kind == "cloud"
    if mesh is not None and len(mesh.vertices):
        hull = hull_points(mesh)
    elif outline is not None:
        hull = shapely.get_coordinates(outline, include_z=True)
    else:
        raise ValueError(f"a {shape.kind} shape with neither mesh nor outline")
    flat = None
    if outline is None and mesh is not None and not is_cloud:
        outline = ground_outline(mesh, hull)
    if outline is not None:
        flat = shapely.to_wkb(shapely.multipolygons(shapely.get_parts(shapely.force_2d(outline))))
    faces = 0 if mesh is None or is_cloud else len(mesh.faces)
    closed = mesh is not None and not is_cloud and mesh.is_closed
    cursor.execute(
        "INSERT INTO model (digest, kind, uri, triangles, closed, hull, outline) "
        "VALUES (%s, %s, %s, %s, %s, ST_GeomFromWKB(%s, 0), ST_GeomFromWKB(%s, 0)) RETURNING id",
        (digest, shape.kind, shape.uri, faces, closed, _points(hull), flat),
    )
    row = cursor.fetchone()
    assert row is not None
    model_id: int = row[0]
    if mesh is not None:
        patches = iter([_points(mesh.vertices)]) if is_cloud else encode_chunks(mesh.triangles)
        columns = ("model_id", "number", "geom")
        with writable_table(cursor, "chunk", columns) as table:
            statement = copy_statement(table, columns) + sql.SQL(" (FORMAT BINARY)")
            with cursor.copy(statement) as copy:
                copy.set_types(["int8", "int4", "bytea"])
                for number, patch in enumerate(patches):
                    copy.write_row((model_id, number, patch))
    return model_id


def _points(points: NDArray[np.float64]) -> bytes:
    """(N, 3) points as WKB."""
    wkb: bytes = shapely.to_wkb(shapely.multipoints(shapely.points(points)), output_dimension=3)
    return wkb
