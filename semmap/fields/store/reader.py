"""Reads what fields are made of from the database: meshes, walls, rooms and regions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import text

from semmap.fields.regions.mesh_regions import mesh_parts
from semmap.fields.regions.shapes import Region, Solid, SurfaceRegion
from semmap.fields.sources.percepts import Zone
from semmap.fields.sources.synthetic_scene import VisibleObject
from semmap.geometry.parts import closed_as_whole
from semmap.geometry.tin import to_mesh
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import OBJECTS, read_entities
from semmap.query.storey_scene import SceneEntity

TOUCH = 2.5e-9
"""Voxels within which a surface touches one: more than the tolerance of drawing."""


@dataclass(frozen=True, eq=False)
class Occupant:
    """An object, a room or a door with a mesh or a point cloud."""

    id: int  # of the entity
    name: str  # of the entity
    triangles: NDArray[np.float64]  # (F, 3, 3) metres, in the frame of the map
    points: NDArray[np.float64] | None = None  # (N, 3) metres, of an entity without triangles
    # the mesh is the shell of a room: it has a surface and no inside
    encloses_air: bool = False

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
        found: list[Region] = [
            SurfaceRegion(mesh.vertices + np.array([x, y, 0.0]), mesh.faces)
            for x in (-TOUCH * voxel_size, TOUCH * voxel_size)
            for y in (-TOUCH * voxel_size, TOUCH * voxel_size)
        ]
        if not self.encloses_air and closed_as_whole(mesh):
            found.append(Solid(mesh.vertices, mesh.faces))
        return found


def read_occupants(seen: Snapshot, ids: Iterable[int] | None = None) -> list[Occupant]:
    """Return the objects of the current map that have geometry; only those of `ids` if given."""
    found = read_entities(seen, ids, kinds=OBJECTS, carried=True)
    return [_occupant(e) for e in found if not e.lacks_geometry]


def read_walls(seen: Snapshot, ids: Iterable[int] | None = None) -> list[Occupant]:
    """Return the shells of rooms with geometry, and the leaves of doors, open ones included."""
    found = read_entities(seen, ids, kinds=("room", "connector"))
    return [_occupant(e) for e in found if len(e.triangles) or e.voxels is not None]


def _occupant(entity: SceneEntity) -> Occupant:
    points = None if entity.voxels is None else entity.voxels.centres
    return Occupant(entity.id, entity.name, entity.triangles, points, entity.kind == "room")


def read_visible_objects(seen: Snapshot) -> list[VisibleObject]:
    """Return the objects and rooms of the current map that have a mesh, for a synthetic camera."""
    found = read_entities(seen, kinds=("object", "room"), carried=True)
    return [VisibleObject(e.name, e.types[0], e.triangles) for e in found if len(e.triangles)]


def read_zones(seen: Snapshot) -> list[Zone]:
    """Return the rooms and regions of the current map that are valid now."""
    found = read_entities(
        seen,
        kinds=("room", "region"),
        moment=seen.moment,
        triangles=False,
        carried=True,
    )
    return [
        Zone(e.name, "room" if e.kind == "room" else "region", e.footprint, e.floor, e.ceiling)
        for e in found
        if e.footprint is not None and e.footprint.area > 0
        if e.floor is not None and e.ceiling is not None
    ]


def read_zone_ids(seen: Snapshot) -> dict[str, int]:
    """Return the id of each room and region of the current map, by name."""
    rows = seen.connection.execute(
        text(
            "SELECT name, id FROM entity "
            "WHERE map_id = current_map() AND kind IN ('room', 'region')"
        )
    )
    return {row.name: row.id for row in rows}
