"""What occupies space, read from the database: the one module of the fields that does so."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, text

from semmap.fields.mesh_regions import parts_of
from semmap.fields.regions import Region
from semmap.geometry.tin import to_mesh
from semmap.query.meshes import world_triangles

__all__ = ["Occupant", "changed_since", "cursor", "read_occupants"]


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


def cursor(connection: Connection) -> str:
    """Where the history stands in this transaction's snapshot."""
    return str(connection.execute(text("SELECT change_cursor()")).scalar_one())


def changed_since(connection: Connection, since: str) -> set[int]:
    """The entities of the current map that changed after a cursor."""
    rows = connection.execute(
        text("SELECT entities FROM changes_since(:since) WHERE map_id = current_map()"),
        {"since": since},
    )
    return {number for (numbers,) in rows for number in numbers}
