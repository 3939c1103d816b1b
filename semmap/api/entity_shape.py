"""The shape of an entity: what Shapely, trimesh and a GIS take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import shapely
    import trimesh

    from semmap.api.map import Map


class EntityShape:
    """The part of `MapEntity` that reads geometry; all of it is in the map's frame, metres."""

    if TYPE_CHECKING:
        map: Map
        id: int

        def _gone(self) -> LookupError: ...

    @property
    def geometry(self) -> shapely.Geometry | None:
        """The 2D shape that a GIS shows.

        Rooms, objects, agents, storeys and regions have their outline, as `footprint`. A door has
        the line of its opening from post to post, stairs and ramps the line along the way. What has
        no outline has the point of its pose, and None without a placement.
        """
        return self._shown()["geometry"]

    @property
    def footprint(self) -> shapely.Polygon | shapely.MultiPolygon | None:
        """The ground that it covers: of a tilted object, of its convex hull; None without geometry.

        Of a door, the ground of its closed leaf, where it has one.
        """
        from semmap.query.entity_shapes import read_footprint

        return read_footprint(self.map.connection, self.id)

    @property
    def mesh(self) -> trimesh.Trimesh | None:
        """Its triangles in the map's frame; None where it has none or no placement."""
        from semmap.query.entity_shapes import read_mesh

        return read_mesh(self.map.connection, self.id)

    @property
    def size(self) -> tuple[float, float, float] | None:
        """The extents (x, y, z) of its geometry in its own frame, metres; None without geometry.

        A turned desk keeps its size; `box` is the box in the map's frame.
        """
        from semmap.query.entity_shapes import read_size

        return read_size(self.map.connection, self.id)

    @property
    def box(self) -> tuple[float, ...] | None:
        """(x0, y0, z0, x1, y1, z1): its 3D box in the map's frame; None without a placement.

        Without geometry, both corners are its origin.
        """
        from semmap.query.entity_shapes import read_box

        return read_box(self.map.connection, self.id)

    @property
    def __geo_interface__(self) -> dict[str, Any]:
        """A GeoJSON Feature, its coordinates metres in the map's frame."""
        from semmap.query.entity_shapes import feature

        return feature(self._shown())

    def _shown(self) -> dict[str, Any]:
        from semmap.query.entity_shapes import read_shapes

        rows = read_shapes(self.map.connection, [self.id])
        if not rows:
            raise self._gone()
        return rows[0]
