"""A map as map features: for GeoPandas, Shapely and Folium, and as a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from semmap.api.map_questions import MapQuestions

if TYPE_CHECKING:
    import geopandas


class MapExport(MapQuestions):
    """The part of `Map` that gives it to a GIS."""

    @property
    def __geo_interface__(self) -> dict[str, Any]:
        """A GeoJSON FeatureCollection of all entities, coordinates in metres of the map's frame.

        Folium shows it as ``folium.GeoJson(house)`` on a ``folium.Map(crs="Simple")``.
        """
        from semmap.query.entity_shapes import feature_collection, read_shapes

        return feature_collection(read_shapes(self._seen))

    def to_geodataframe(self, type: str | None = None) -> geopandas.GeoDataFrame:
        """The entities as a GeoDataFrame: one row each, its index their ids.

        Columns are `name`, `kind`, `type`, `label`, `holder`, `storey`, `low`, `high`, `properties`
        and `geometry` (as `MapEntity.geometry`); it has no CRS, since a map is a local frame in
        metres. `type` leaves those of a semantic type and its subtypes.

        Raises
        ------
        ImportError, LookupError
            GeoPandas is not installed; the map has no such type.
        """
        from semmap.query.entity_shapes import read_shapes

        try:
            import geopandas
        except ImportError as error:
            raise ImportError("to_geodataframe needs GeoPandas: pip install geopandas") from error
        ids = None if type is None else [one.id for one in self.find(type)]
        rows = read_shapes(self._seen, ids)
        columns = ["id", "name", "kind", "type", "label", "holder", "storey", "low", "high"]
        frame = geopandas.GeoDataFrame(
            {key: [row[key] for row in rows] for key in (*columns, "properties")},
            geometry=[row["geometry"] for row in rows],
        )
        return frame.set_index("id")

    def export(self, path: str | Path) -> Path:
        """Write storeys, rooms, doors, regions and objects as map features.

        `Map.import_file` reads them back: names, types, labels, outlines, heights, properties, and
        of doors the places that they join, state, direction, behaviour, width, height, step and
        permissions. It does not read back: meshes (an object is the prism of its footprint), tilts,
        the poses before doors (they are chosen again), doors within one room, history, beliefs,
        statements, fields and links.

        Parameters
        ----------
        path : ``.gpkg``: a layer for each kind; ``.geojson``: one collection. A file that is there
            is replaced

        Raises
        ------
        ValueError
            The ending is neither.
        """
        from semmap.query.feature_export import write_features

        return write_features(self._seen, Path(path))
