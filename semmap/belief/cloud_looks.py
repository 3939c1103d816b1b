"""Objects that a recogniser found in a point cloud, as observations of the map."""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime

import numpy as np
from numpy.typing import ArrayLike

from semmap.belief.error import BeliefError
from semmap.belief.looks import observe_view
from semmap.belief.store.beliefs import Row
from semmap.draw.depth_camera import DepthCamera
from semmap.geometry.mesh import Mesh
from semmap.perception.models import KnownObject, train_model
from semmap.perception.placeholders import Placeholder
from semmap.perception.point_cloud import Floats
from semmap.perception.recognition import RATES, recognise
from semmap.perception.registration import moved
from semmap.query.entity_query import entity_id
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import read_entities
from semmap.query.storey_scene import EntityKind

SPACING = 0.004
"""Metres between the points of furniture, on average."""


def observe_cloud(
    seen: Snapshot,
    camera: DepthCamera,
    cloud: ArrayLike,
    looked_for: Collection[str],
    *,
    without: Collection[str] = (),
    furthest: float = 5.0,
    at: datetime | None = None,
    observer: str | None = None,
    hit: float | None = None,
    false_alarm: float | None = None,
) -> list[Row]:
    """Recognise objects of the map on the table that a camera saw, and store the observations.

    The camera's pose is the optical frame (x right, y down, z ahead) in the map's frame. The cloud,
    (n, 3) or (height, width, 3), is in the optical frame, metres; NaN where nothing was seen.
    Points of furniture `without` are removed first. The default rates were measured on the YCB
    objects. `PerceptionError` if there is no table; `BeliefError` for an object without a mesh.
    """
    models = read_models(seen, looked_for)
    placeholders = [
        Placeholder(_surface(triangles), np.asarray(np.linalg.inv(camera.pose), float))
        for triangles in _read_triangles(seen, without).values()
    ]
    up = camera.pose[:3, :3].T @ (0.0, 0.0, 1.0)
    best: dict[str, tuple[float, list[float]]] = {}
    for found in recognise(cloud, models, up=up, placeholders=placeholders):
        if found.name is None or found.pose is None:
            continue
        if found.score > best.get(found.name, (0.0, []))[0]:
            model = next(model for model in models if model.name == found.name)
            middle = (model.points.min(axis=0) + model.points.max(axis=0)) / 2
            point = moved(camera.pose @ found.pose, middle[None])[0]
            best[found.name] = (found.score, [float(v) for v in point])
    return observe_view(
        seen,
        camera,
        looked_for,
        {name: point for name, (_, point) in best.items()},
        furthest=furthest,
        at=at,
        observer=observer,
        hit=RATES[0] if hit is None else hit,
        false_alarm=RATES[1] if false_alarm is None else false_alarm,
    )


def read_models(seen: Snapshot, names: Collection[str]) -> list[KnownObject]:
    """Return models of objects, trained from their meshes as they stand in the map.

    The origin is the lowest corner of the box around the mesh. `BeliefError` without a mesh.
    """
    if not names:
        raise BeliefError("name the objects that the recogniser looks for")
    models = []
    for name, triangles in _read_triangles(seen, names).items():
        mesh = Mesh.of_triangles(triangles - triangles.min(axis=(0, 1)))
        models.append(train_model(name, mesh))
    return models


def _read_triangles(seen: Snapshot, names: Collection[str]) -> dict[str, Floats]:
    """The triangles (F, 3, 3) of objects in the map's frame, by name."""
    for name in names:
        entity_id(seen.session, name)
    if not names:
        return {}
    objects: tuple[EntityKind, ...] = ("object",)
    entities = {e.name: e for e in read_entities(seen, kinds=objects) if e.name in names}
    for name in names:
        if name not in entities or not len(entities[name].triangles):
            raise BeliefError(f"{name} has no mesh to recognise it by: import it with its geometry")
    return {name: entities[name].triangles for name in sorted(names)}


def _surface(triangles: Floats) -> Floats:
    """Points (n, 3) evenly over triangles, dense enough to leave no holes."""
    random = np.random.default_rng(0)
    sides = triangles[:, 1:] - triangles[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    count = int(np.clip(area.sum() / 2 / SPACING**2, 1000, 500_000))
    chosen = random.choice(len(triangles), count, p=area / area.sum())
    share = random.random((count, 2))
    share = np.where(share.sum(axis=1, keepdims=True) > 1, 1 - share, share)
    return np.asarray(triangles[chosen, 0] + np.einsum("nk,nki->ni", share, sides[chosen]))
