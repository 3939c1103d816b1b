"""Reads what fields are made of from the database: meshes, names, rooms and regions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from sqlalchemy import Connection, text

from semmap.database.files import schema_folder
from semmap.fields.maps.vocabulary import Vocabulary, read_vocabulary
from semmap.fields.regions.mesh_regions import mesh_parts
from semmap.fields.regions.shapes import Region
from semmap.fields.sources.percepts import Zone
from semmap.fields.sources.synthetic_scene import VisibleObject
from semmap.geometry.tin import to_mesh
from semmap.ingest.ontology.tbox import snake_case
from semmap.language.names import NameIndex
from semmap.query.meshes import world_triangles

__all__ = [
    "Occupant",
    "read_map_vocabulary",
    "read_names",
    "read_occupants",
    "read_server_id",
    "read_visible_objects",
    "read_zones",
]


HEIGHT = 2.5
"""Height in metres of a zone without one."""


@dataclass(frozen=True, eq=False)
class Occupant:
    """An object with a mesh.

    Attributes
    ----------
    id : of the entity
    name : of the entity
    triangles : (F, 3, 3) metres, in the frame of the map
    """

    id: int
    name: str
    triangles: NDArray[np.float64]

    def regions(self, voxel_size: float) -> list[Region]:
        """Return the inside of its closed parts, and the surfaces of its open parts."""
        return mesh_parts(to_mesh(self.triangles)).regions(voxel_size)


def read_occupants(connection: Connection, ids: Iterable[int] | None = None) -> list[Occupant]:
    """Return the objects of the current map that have a mesh; only those of `ids` if given."""
    rows = connection.execute(
        text(
            "SELECT e.id, e.name FROM entity e JOIN world w ON w.entity_id = e.id "
            "WHERE e.map_id = current_map() AND e.kind = 'object' "
            "AND (CAST(:ids AS bigint[]) IS NULL OR e.id = ANY(:ids)) ORDER BY e.id"
        ),
        {"ids": None if ids is None else [*ids]},
    ).all()
    triangles = world_triangles(connection, [row.id for row in rows])
    return [
        Occupant(row.id, row.name, triangles[row.id])
        for row in rows
        if len(triangles.get(row.id, ()))
    ]


def read_names(connection: Connection) -> NameIndex:
    """Return the entities of the current map with their types, and the types of the T-Box."""
    entities = connection.execute(
        text("SELECT name, coalesce(type, kind) AS type FROM entity WHERE map_id = current_map()")
    )
    supertypes: dict[str, set[str]] = {}
    for sub, super_ in connection.execute(text("SELECT sub, super FROM type_closure")):
        supertypes.setdefault(sub, set()).add(super_)
    labels = connection.execute(text("SELECT name, label FROM semantic_type WHERE label <> name"))
    return NameIndex(
        {row.name: row.type for row in entities},
        {sub: frozenset(each) for sub, each in supertypes.items()},
        {snake_case(row.label): row.name for row in labels},
    )


def read_visible_objects(connection: Connection) -> list[VisibleObject]:
    """Return the objects and rooms of the current map that have a mesh, for a synthetic camera."""
    rows = connection.execute(
        text(
            "SELECT id, name, coalesce(type, kind) AS type FROM entity "
            "WHERE map_id = current_map() AND kind IN ('object', 'room') ORDER BY id"
        )
    ).all()
    triangles = world_triangles(connection, [row.id for row in rows])
    return [
        VisibleObject(row.name, row.type, triangles[row.id])
        for row in rows
        if len(triangles.get(row.id, ()))
    ]


def read_zones(connection: Connection, ids: Iterable[int] | None = None) -> list[Zone]:
    """Return the rooms and regions of the current map that are valid now.

    A room extends from its floor to the top of its box; a zone without a height is `HEIGHT` high.

    Parameters
    ----------
    connection : sees the map
    ids : only the zones of these entities; all if not given
    """
    rows = connection.execute(
        text(
            "SELECT e.name, e.kind, ST_AsBinary(w.footprint) AS outline, "
            "CASE WHEN e.kind = 'room' THEN coalesce(w.pose[3] + r.floor, ST_ZMin(w.box)) "
            "ELSE ST_ZMin(w.box) END AS low, "
            "coalesce(w.pose[3] + r.ceiling, ST_ZMax(w.box)) AS high "
            "FROM entity e JOIN world w ON w.entity_id = e.id "
            "LEFT JOIN room r ON r.entity_id = e.id LEFT JOIN region g ON g.entity_id = e.id "
            "WHERE e.map_id = current_map() AND e.kind IN ('room', 'region') "
            "AND w.footprint IS NOT NULL AND (g.valid IS NULL OR g.valid @> now()) "
            "AND (CAST(:ids AS bigint[]) IS NULL OR e.id = ANY(:ids)) ORDER BY e.id"
        ),
        {"ids": None if ids is None else [*ids]},
    )
    zones = []
    for row in rows:
        outline = shapely.from_wkb(bytes(row.outline))
        high = row.high if row.high - row.low > 0.1 else row.low + HEIGHT
        if outline.area > 0:
            zones.append(Zone(row.name, row.kind, outline, float(row.low), float(high)))
    return zones


def read_map_vocabulary() -> Vocabulary:
    """Return the properties that the ontology of semmap declares."""
    return read_vocabulary([schema_folder() / "ontology" / "fields.ttl"])


def read_server_id(connection: Connection) -> str:
    """Return the identifier of the database cluster, in which alone its cursors are valid."""
    return str(
        connection.execute(text("SELECT system_identifier FROM pg_control_system()")).scalar_one()
    )
