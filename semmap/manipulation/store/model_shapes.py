"""The primitive of each model: found once in its mesh, stored for all instances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from semmap.belief.store.beliefs import Session
from semmap.found_rows import FoundRows
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.reader import read_shape
from semmap.manipulation.store.models import object_model_id, set_shape
from semmap.query.entity_query import entity_id
from semmap.query.meshes import models_triangles
from semmap.query.snapshot import Snapshot

if TYPE_CHECKING:
    import trimesh
    from numpy.typing import NDArray

    from semmap.perception.primitives import Primitive


@dataclass(frozen=True)
class StoredShape:
    """A primitive of a kind and size as in `SIZES`, at (4, 4) in the model's frame."""

    kind: str
    size: tuple[float, ...]
    pose: NDArray[np.float64]
    inliers: float = 1.0


def shape_of(seen: Snapshot, entity: str) -> StoredShape:
    """The primitive of an entity's model, fitted at need; ManipulationError without a volume."""
    model = object_model_id(seen.session, entity)
    found = stored_shape(seen.session, model)
    if found is None:
        set_shape(seen.session, model, mesh_shape(seen, entity))
        found = stored_shape(seen.session, model)
        assert found is not None
    return found


def stored_shape(session: Session, model: int) -> StoredShape | None:
    """The primitive that is stored of an object model; None where there is none."""
    row = read_shape(session, model)
    if row is None:
        return None
    fits = row["inliers"] or 0.0  # nobody stated how well it fits
    return StoredShape(row["shape"], tuple(row["size"]), row["shape_pose"].matrix, fits)


def mesh_shape(seen: Snapshot, entity: str) -> Primitive:
    """The primitive of an entity's mesh; ManipulationError without a volume."""
    from semmap.perception.mesh_shapes import mesh_primitive  # SciPy is slow to load
    from semmap.perception.point_cloud import PerceptionError

    try:
        return mesh_primitive(model_mesh(seen, entity))
    except PerceptionError as error:
        raise ManipulationError(f"{entity}: {error}") from error


def model_mesh(seen: Snapshot, entity: str) -> trimesh.Trimesh:
    """The visual mesh of an entity, else its collision mesh, in the frame of its model."""
    import trimesh

    row = seen.session.execute(
        "SELECT m.id FROM entity_model em JOIN model m ON m.id = em.model_id "
        "JOIN entity e ON e.id = em.entity_id WHERE e.map_id = current_map() AND e.name = %s "
        "AND m.triangles > 0 ORDER BY em.role DESC, m.id LIMIT 1",
        (entity,),
    ).fetchone()
    if row is None:
        raise ManipulationError(f"{entity}: has no mesh: import one, or give its size")
    triangles = models_triangles(seen.session, [row[0]])[row[0]]
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    mesh = trimesh.Trimesh(triangles.reshape(-1, 3), faces, process=False)
    mesh.merge_vertices()
    return mesh


def store_shapes(
    seen: Snapshot,
    names: Sequence[str] | None = None,
    progress: Callable[[str, int, int], None] = lambda name, done, total: None,
) -> FoundRows:
    """Store the primitives of all meshes of the map, or those of some entities, that have none yet.

    Rows have `entity`, `shape`, `size` (metres) and `inliers`; `problems` says why a mesh has none.
    `progress` is called with each name, how many are done and how many there are.
    """
    for name in names or ():
        entity_id(seen.session, name)
    found = seen.session.execute(
        "SELECT DISTINCT ON (coalesce(object_of(e.id)::text, m.digest)) e.name FROM entity e "
        "JOIN entity_model em ON em.entity_id = e.id "
        "JOIN model m ON m.id = em.model_id AND m.triangles > 0 "
        "WHERE e.map_id = current_map() AND e.kind = 'object' "
        "AND (%(all)s OR e.name = ANY (%(names)s)) "
        "ORDER BY coalesce(object_of(e.id)::text, m.digest), e.name",
        {"all": names is None, "names": list(names or ())},
    ).fetchall()
    rows, problems = [], []
    for done, (name,) in enumerate(sorted(found)):
        progress(name, done, len(found))
        try:
            with seen.session.transaction():
                shape = shape_of(seen, name)
        except ManipulationError as error:
            problems.append(str(error))
        else:
            size = list(shape.size)
            found_row = {"entity": name, "shape": shape.kind, "size": size}
            rows.append(found_row | {"inliers": shape.inliers})
    return FoundRows(rows, problems)
