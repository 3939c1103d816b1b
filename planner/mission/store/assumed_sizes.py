"""Typical boxes for objects without geometry, in a copy of a map: things can stand on them."""

from __future__ import annotations

import numpy as np

from semmap.geometry.mesh import Mesh
from semmap.ingest.store.holder_store import find_surfaces
from semmap.ingest.store.model_store import store_models
from semmap.ingest.world import Entry, Shape
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import read_entities

DIGITS = 6  # decimals of the corners, so that equal boxes at different places are one model


def store_assumed_sizes(seen: Snapshot) -> list[str]:
    """Give the objects without geometry a typical box for their type, and return their names.

    For maps in which a simulation happens: what is assumed is no part of a map that robots share.
    """
    found = read_entities(seen, kinds=["object"], assume_sizes=True)
    assumed = [entity for entity in found if entity.assumed]
    entries = []
    for entity in assumed:
        corners = entity.pose.inverse().apply(entity.triangles.reshape(-1, 3)).round(DIGITS) + 0.0
        vertices, faces = np.unique(corners, axis=0, return_inverse=True)
        mesh = Mesh(vertices, faces.reshape(-1, 3).astype(np.int32))
        entries.append(Entry(entity.name, "object", shapes=[Shape("box", mesh)]))
    session = seen.session
    with session.cursor() as cursor:
        models, _ = store_models(cursor, entries, lambda stage, done, total: None)
        rows = [
            (entity.id, models[id(entry.shapes[0])])
            for entity, entry in zip(assumed, entries, strict=True)
        ]
        cursor.executemany("INSERT INTO entity_model (entity_id, model_id) VALUES (%s, %s)", rows)
    ((map_id,),) = session.execute("SELECT current_map()").fetchall()
    find_surfaces(session, map_id)
    return sorted(entity.name for entity in assumed)
