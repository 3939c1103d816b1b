"""Reads what fields are made of from the database: meshes, walls, zones and agents."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import text

from semmap.fields.regions.mesh_regions import mesh_parts
from semmap.fields.regions.region_map import Role
from semmap.fields.regions.shaped_region import Cylinder, Region, Solid, SurfaceRegion
from semmap.fields.sources.percepts import Zone
from semmap.fields.sources.synthetic_scene import VisibleObject
from semmap.geometry.parts import closed_as_whole
from semmap.geometry.tin import to_mesh
from semmap.query.meshes import world_triangles
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import OBJECTS, read_entities
from semmap.query.storey_scene import SceneEntity

TOUCH = 2.5e-9
"""Voxels within which a surface touches one: more than the tolerance of drawing."""

BORDER = 1e-6
"""Voxels from a border within which the end of a face is drawn on both sides of it."""

PERSON = (0.25, 1.75)
"""Radius and height in metres of a person without geometry."""


@dataclass(frozen=True, eq=False)
class Occupant:
    """An object, a room or a door with a mesh or a point cloud."""

    id: int  # of the entity
    name: str  # of the entity
    triangles: NDArray[np.float64]  # (F, 3, 3) metres, in the frame of the map
    points: NDArray[np.float64] | None = None  # (N, 3) metres, of an entity without triangles
    # the mesh is the shell of a room: it has a surface and no inside
    encloses_air: bool = False
    role: Role = "object"

    def regions(self, voxel_size: float) -> list[Region]:
        """Return the inside of closed parts and the surfaces of open parts, or the points."""
        if self.points is not None:
            return [self.points]
        if self.encloses_air:
            shell = to_mesh(self.triangles)
            return [SurfaceRegion(shell.vertices, shell.faces)]
        return mesh_parts(to_mesh(self.triangles)).regions(voxel_size)

    def cover(self, voxel_size: float) -> list[Region]:
        """Return all that is occupied, for grids: no voxel that the surface meets is left out.

        A voxel that it only touches is one of them, on all sides: it lies there by rounding. A
        surface that is closed as a whole has an inside, as for `navgrid.slabs`.
        """
        if self.points is not None:
            return [self.points]
        mesh = to_mesh(self.triangles)
        apart = np.array([(x, y, 0.0) for x in (-TOUCH, TOUCH) for y in (-TOUCH, TOUCH)])
        ends = _ends_on_borders(self.triangles[..., :2] / voxel_size)
        found: list[Region] = []
        for faces, moves in ((mesh.faces[~ends], np.zeros((1, 3))), (mesh.faces[ends], apart)):
            if len(faces):
                found += [SurfaceRegion(mesh.vertices + m * voxel_size, faces) for m in moves]
        if not self.encloses_air and closed_as_whole(mesh):
            found.append(Solid(mesh.vertices, mesh.faces))
        return found


def _ends_on_borders(triangles: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(F,) whether the box of a face (F, 3, 2), in voxels, ends on a border between voxels.

    Only there does drawing leave out a voxel that the face touches.
    """
    ends = np.stack([triangles.min(axis=1), triangles.max(axis=1)])
    on: NDArray[np.bool_] = (np.abs(ends - np.round(ends)) < BORDER).any(axis=(0, 2))
    return on


def read_occupants(seen: Snapshot, ids: Iterable[int] | None = None) -> list[Occupant]:
    """Return the objects of the current map that have geometry; only those of `ids` if given."""
    found = read_entities(seen, ids, kinds=OBJECTS, carried=True)
    (parts,) = seen.connection.execute(text("SELECT building_parts()")).one()
    return [
        _occupant(e, "building part" if e.types[0] in parts else "object")
        for e in found
        if not e.lacks_geometry
    ]


def read_walls(seen: Snapshot, ids: Iterable[int] | None = None) -> list[Occupant]:
    """Return the shells of rooms with geometry, and the leaves of doors, open ones included."""
    found = read_entities(seen, ids, kinds=("room", "connector"))
    return [_occupant(e) for e in found if len(e.triangles) or e.voxels is not None]


def _occupant(entity: SceneEntity, role: Role = "object") -> Occupant:
    points = None if entity.voxels is None else entity.voxels.centres
    is_room = entity.kind == "room"
    return Occupant(entity.id, entity.name, entity.triangles, points, is_room, role)


def read_visible_objects(seen: Snapshot) -> list[VisibleObject]:
    """Return the objects and rooms of the current map that have a mesh, for a synthetic camera."""
    found = read_entities(seen, kinds=("object", "room"), carried=True)
    return [VisibleObject(e.name, e.types[0], e.triangles) for e in found if len(e.triangles)]


def read_zones(seen: Snapshot, ids: Iterable[int] | None = None) -> dict[int, Zone]:
    """Return the rooms and regions of the current map that are valid now; only of `ids` if given.

    By id.
    """
    found = read_entities(
        seen, ids, kinds=("room", "region"), moment=seen.moment, triangles=False, carried=True
    )
    return {
        e.id: Zone(
            e.name, "room" if e.kind == "room" else "region", e.footprint, e.floor, e.ceiling
        )
        for e in found
        if e.footprint is not None and e.footprint.area > 0
        if e.floor is not None and e.ceiling is not None
    }


def read_timed_regions(seen: Snapshot) -> set[int]:
    """Return the regions of the current map that begin or end to be valid at some time."""
    rows = seen.connection.execute(
        text(
            "SELECT entity_id FROM region JOIN entity e ON e.id = entity_id "
            "WHERE e.map_id = current_map() AND NOT (lower_inf(valid) AND upper_inf(valid))"
        )
    )
    return {*rows.scalars()}


def read_homes(seen: Snapshot, ids: Iterable[int] | None = None) -> dict[int, int | None]:
    """Return the room of each object and agent of the current map; only of `ids` if given."""
    rows = seen.connection.execute(
        text(
            "SELECT id, room_of(id) AS room FROM entity "
            "WHERE map_id = current_map() AND kind IN ('object', 'agent') "
            "AND (CAST(:ids AS bigint[]) IS NULL OR id = ANY(:ids))"
        ),
        {"ids": None if ids is None else [*ids]},
    )
    return {row.id: row.room for row in rows}


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
