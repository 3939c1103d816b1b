"""Voxels that an update gave to entities, or took from them: kept until their geometry changes.

They are a field `voxels of NAME`, and move with the pose of the entity. A name that the map does
not have becomes a region ("VDB-based Spatially Grounded Semantics", section IV).
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray

from semmap.fields.maps.lattice import Lattice
from semmap.fields.regions.region_map import Role
from semmap.fields.store import field_store
from semmap.fields.store.run_statement import run
from semmap.geometry.pose import Pose
from semmap.query.refusal import denied
from semmap.query.snapshot import Snapshot
from semmap_vdb import BoolGrid

OCCUPIES = "urn:semmap:ontology#occupies"

VOXEL = 0.05
"""Metres of the voxels that are compared with geometry."""

APART = 0.5
"""Metres between a stated voxel and the geometry of an entity, above which one of them is wrong."""

MODELS = (
    "coalesce((SELECT array_agg(m.model_id ORDER BY m.model_id) FROM entity_model m "
    "WHERE m.entity_id = e.id), '{}') AS models "
)


@dataclass(frozen=True, eq=False)
class StatedVoxels:
    """The voxels of an entity in place of those of its geometry."""

    id: int  # of the entity
    name: str  # of the entity
    role: Role  # of the entity
    points: NDArray[np.float64]  # (N, 3) centres of the voxels in the frame of the map, metres


def read_stated(seen: Snapshot, ids: Iterable[int] | None, voxel_size: float) -> list[StatedVoxels]:
    """Return the entities with stated voxels, of this size in metres; of `ids` if given."""
    rows = run(
        seen.session,
        "SELECT e.id, e.name, e.kind, is_building_part(e.type) AS is_part, w.pose, "
        f"f.name AS field, v.state, {MODELS} FROM field f "
        "JOIN field_version v ON v.field_id = f.id AND v.version = f.version "
        "JOIN entity e ON e.map_id = f.map_id AND e.name = f.about "
        "LEFT JOIN world w ON w.entity_id = e.id "
        "WHERE f.map_id = current_map() AND f.property = %(occupies)s "
        "AND (%(ids)s::bigint[] IS NULL OR e.id = ANY(%(ids)s))",
        {"occupies": OCCUPIES, "ids": None if ids is None else [*ids]},
    )
    found = []
    for row in rows:
        if row.state["models"] != row.models:
            continue
        grid = field_store.load(seen, row.field).grid
        assert isinstance(grid, BoolGrid)
        if abs(grid.voxel_size - voxel_size) > 1e-9:
            grid = grid.resampled(voxel_size, Lattice(voxel_size).rows)
        points = np.asarray((grid.read()[0] + 0.5) * voxel_size, np.float64)
        if row.pose is not None and row.state["pose"] is not None and row.pose != row.state["pose"]:
            moved = Pose(*row.pose) @ Pose(*row.state["pose"]).inverse()
            points = moved.apply(points)
        found.append(StatedVoxels(row.id, row.name, _role(row.kind, row.is_part), points))
    return found


def voxels_apart(seen: Snapshot) -> list[tuple[str, float]]:
    """The entities with stated voxels farther than `APART` from the box around their geometry.

    Each with the distance of the farthest one, metres.
    """
    stated = {each.id: each for each in read_stated(seen, None, VOXEL) if len(each.points)}
    rows = run(
        seen.session,
        "SELECT w.entity_id AS id, ARRAY[ST_XMin(w.box), ST_YMin(w.box), ST_ZMin(w.box)] AS low, "
        "ARRAY[ST_XMax(w.box), ST_YMax(w.box), ST_ZMax(w.box)] AS high FROM world w "
        "WHERE w.entity_id = ANY(%(ids)s) AND w.box IS NOT NULL ORDER BY w.entity_id",
        {"ids": [*stated]},
    )
    found = []
    for row in rows:
        points = stated[row.id].points
        nearest = np.clip(points, row.low, row.high)
        away = float(np.linalg.norm(points - nearest, axis=1).max())
        if away > APART:
            found.append((stated[row.id].name, away))
    return found


def save_stated(
    session: psycopg.Connection[Any], name: str, voxels: NDArray[np.int32], voxel_size: float
) -> None:
    """State all voxels (N, 3) of an entity.

    An unknown entity becomes a region of the map; a region that was made so and has no voxels any
    more is deleted.
    """
    field = f"voxels of {name}"
    (known,) = run(
        session,
        "SELECT (SELECT id FROM entity WHERE map_id = current_map() AND name = %(name)s) AS id, "
        "(SELECT (v.state->>'made')::boolean FROM field f JOIN field_version v "
        "ON v.field_id = f.id AND v.version = f.version "
        "WHERE f.map_id = current_map() AND f.name = %(field)s) AS made",
        {"name": name, "field": field},
    )
    made = known.id is None or bool(known.made)
    if not len(voxels) and made:
        field_store.forget(session, field)
        run(session, "DELETE FROM entity WHERE id = %(id)s", {"id": known.id})
        return
    if known.id is None:
        _make_region(session, name, voxels, voxel_size)
    (row,) = run(
        session,
        f"SELECT e.id, w.pose, {MODELS} "
        "FROM entity e LEFT JOIN world w ON w.entity_id = e.id WHERE e.id = entity_id(%(name)s)",
        {"name": name},
    )
    grid = BoolGrid(voxel_size, False)
    grid.set(voxels, np.ones(len(voxels), np.bool_))
    version = field_store.save(
        session,
        field,
        grid,
        property=OCCUPIES,
        about=name,
        state={"pose": row.pose, "models": row.models, "made": made},
    )
    changed = run(  # this announces the change to all that follow the map
        session,
        "UPDATE entity SET properties = properties || jsonb_build_object('voxels', "
        "%(version)s::integer) WHERE id = %(id)s RETURNING 1",
        {"version": version, "id": row.id},
    )
    if not changed:
        raise denied()


def _make_region(
    session: psycopg.Connection[Any], name: str, voxels: NDArray[np.int32], voxel_size: float
) -> None:
    """Add a region with the outline of voxels, from their bottom to their top."""
    import shapely

    from semmap.geometry.mesh import prism_mesh
    from semmap.ingest.store.world_store import store_world
    from semmap.ingest.world import Entry, Shape, World

    low = np.unique(voxels[:, :2], axis=0) * voxel_size
    outline = shapely.union_all(shapely.box(*low.T, *(low + voxel_size).T), grid_size=1e-6)
    bottom, top = voxels[:, 2].min() * voxel_size, (voxels[:, 2].max() + 1) * voxel_size
    middle = outline.representative_point()
    local = shapely.transform(outline, lambda xy: xy - [middle.x, middle.y])
    shape = Shape("polygon", prism_mesh(local, 0.0, float(top - bottom)), outline=local)
    pose = Pose(float(middle.x), float(middle.y), float(bottom))
    entry = Entry(name, "region", pose=pose, shapes=[shape])
    (row,) = run(session, "SELECT m.id, m.name FROM map m WHERE m.id = current_map()")
    source = f"semmap.fields/{uuid.uuid4()}"
    store_world(session, row.id, World(row.name, Path(), [entry]), source)
    run(
        session,
        "UPDATE entity SET source = NULL, digest = NULL WHERE id = entity_id(%(name)s)",
        {"name": name},
    )


def _role(kind: str, is_part: bool) -> Role:
    if kind in ("agent", "room", "region"):
        return kind  # type: ignore[return-value]
    return "building part" if is_part else "object"
