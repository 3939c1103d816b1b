"""Reads the agents of a map: those with geometry, and people without, who get a typical body."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from sqlalchemy import text

from semmap.fields.regions.shapes import Cylinder, Region, SurfaceRegion
from semmap.geometry.tin import to_mesh
from semmap.query.meshes import world_triangles
from semmap.query.snapshot import Snapshot

PERSON = (0.25, 1.75)
"""Radius and height in metres of a person without geometry."""


@dataclass(frozen=True, eq=False)
class StandingAgent:
    """An agent with a body."""

    id: int  # of the entity
    name: str  # of the entity
    body: Region  # in the frame of the map


def read_agents(seen: Snapshot, ids: Iterable[int] | None = None) -> list[StandingAgent]:
    """Return the agents of the current map that have a body; only those of `ids` if given.

    An agent without geometry gets the body of a person, standing at its pose, if it is a person or
    its type is not known. Other agents without geometry, such as robots, are left out.
    """
    rows = seen.connection.execute(
        text(
            "SELECT e.id, e.name, w.pose, e.type IS NULL OR EXISTS (SELECT FROM type_closure c "
            "WHERE c.sub = e.type AND c.super = 'person') AS is_person "
            "FROM entity e JOIN world w ON w.entity_id = e.id "
            "WHERE e.map_id = current_map() AND e.kind = 'agent' "
            "AND (CAST(:ids AS bigint[]) IS NULL OR e.id = ANY(:ids)) ORDER BY e.id"
        ),
        {"ids": None if ids is None else [*ids]},
    ).all()
    triangles = world_triangles(seen.session, [row.id for row in rows]) if rows else {}
    radius, height = PERSON
    agents = []
    for row in rows:
        if len(triangles.get(row.id, ())):
            mesh = to_mesh(triangles[row.id])
            agents.append(StandingAgent(row.id, row.name, SurfaceRegion(mesh.vertices, mesh.faces)))
        elif row.is_person and row.pose is not None:
            x, y, z = row.pose[:3]
            body = Cylinder((x, y, z + height / 2), radius, height)
            agents.append(StandingAgent(row.id, row.name, body))
    return agents
