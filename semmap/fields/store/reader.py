"""What occupies space, read from the database."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from sqlalchemy import Connection, text

from semmap.database.files import schema_folder
from semmap.fields.regions.mesh_regions import parts_of
from semmap.language.names import Names
from semmap.fields.regions.shapes import Region
from semmap.fields.sources.percepts import Zone
from semmap.fields.sources.synthetic_scene import Prop
from semmap.fields.maps.vocabulary import Vocabulary, read_vocabulary
from semmap.geometry.tin import to_mesh
from semmap.ingest.tbox import snake_case
from semmap.query.meshes import world_triangles

__all__ = [
    "Occupant",
    "read_names",
    "read_occupants",
    "read_props",
    "read_vocabulary_of_map",
    "read_zones",
    "server",
]


HEIGHT = 2.5
"""Metres above the floor of a zone of which no height is known."""


@dataclass(frozen=True, eq=False)
class Occupant:
    """A thing of the map: its id, its name, and the triangles (F, 3, 3) it has in the world."""

    id: int
    name: str
    triangles: NDArray[np.float64]

    def regions(self, voxel_size: float) -> list[Region]:
        """The solids that its closed parts enclose, and the surfaces of the open ones."""
        return parts_of(to_mesh(self.triangles)).regions(voxel_size)


def read_occupants(connection: Connection, ids: Iterable[int] | None = None) -> list[Occupant]:
    """The objects of the current map that have a mesh, or those of them with these ids."""
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


def read_names(connection: Connection) -> Names:
    """The entities of the current map with their types, and the T-Box."""
    entities = connection.execute(
        text("SELECT name, coalesce(type, kind) AS type FROM entity WHERE map_id = current_map()")
    )
    supers: dict[str, set[str]] = {}
    for sub, super_ in connection.execute(text("SELECT sub, super FROM type_closure")):
        supers.setdefault(sub, set()).add(super_)
    labels = connection.execute(text("SELECT name, label FROM semantic_type WHERE label <> name"))
    return Names(
        {row.name: row.type for row in entities},
        {sub: frozenset(each) for sub, each in supers.items()},
        {snake_case(row.label): row.name for row in labels},
    )


def read_props(connection: Connection) -> list[Prop]:
    """The objects and rooms of the current map that have a mesh, as a camera sees them."""
    rows = connection.execute(
        text(
            "SELECT id, name, coalesce(type, kind) AS type FROM entity "
            "WHERE map_id = current_map() AND kind IN ('object', 'room') ORDER BY id"
        )
    ).all()
    triangles = world_triangles(connection, [row.id for row in rows])
    return [
        Prop(row.name, row.type, triangles[row.id])
        for row in rows
        if len(triangles.get(row.id, ()))
    ]


def read_zones(connection: Connection, ids: Iterable[int] | None = None) -> list[Zone]:
    """The rooms and regions of the current map that hold now, from their floor to their height.

    A room reaches from its floor to the top of its box; one without a height `HEIGHT` up.

    Parameters
    ----------
    ids : only those of these entities
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


def read_vocabulary_of_map() -> Vocabulary:
    """The properties that semmap's own ontology declares."""
    return read_vocabulary([schema_folder() / "ontology" / "fields.ttl"])


def server(connection: Connection) -> str:
    """Which cluster this is: cursors of one mean nothing to another."""
    return str(
        connection.execute(text("SELECT system_identifier FROM pg_control_system()")).scalar_one()
    )
