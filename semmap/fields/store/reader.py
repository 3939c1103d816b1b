"""Reads what fields are made of from the database: meshes, names, rooms and regions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
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
from semmap.query.storey_reader import OBJECTS, read_entities

__all__ = [
    "Occupant",
    "read_map_vocabulary",
    "read_names",
    "read_occupants",
    "read_server_id",
    "read_visible_objects",
    "read_zones",
]


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
    found = read_entities(connection, ids, kinds=OBJECTS, carried=True)
    return [Occupant(e.id, e.name, e.triangles) for e in found if len(e.triangles)]


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
    found = read_entities(connection, kinds=("object", "room"), carried=True)
    return [VisibleObject(e.name, e.types[0], e.triangles) for e in found if len(e.triangles)]


def read_zones(connection: Connection, ids: Iterable[int] | None = None) -> list[Zone]:
    """Return the rooms and regions of the current map that are valid now.

    Parameters
    ----------
    connection : sees the map
    ids : only the zones of these entities; all if not given
    """
    found = read_entities(
        connection,
        ids,
        kinds=("room", "region"),
        moment=datetime.now(UTC),
        triangles=False,
        carried=True,
    )
    return [
        Zone(e.name, "room" if e.kind == "room" else "region", e.footprint, e.floor, e.ceiling)
        for e in found
        if e.footprint is not None and e.footprint.area > 0
        if e.floor is not None and e.ceiling is not None
    ]


def read_map_vocabulary() -> Vocabulary:
    """Return the properties that the ontology of semmap declares."""
    return read_vocabulary([schema_folder() / "ontology" / "fields.ttl"])


def read_server_id(connection: Connection) -> str:
    """Return the identifier of the database cluster, in which alone its cursors are valid."""
    return str(
        connection.execute(text("SELECT system_identifier FROM pg_control_system()")).scalar_one()
    )
