"""A map as map features: for GeoPandas, Shapely and Folium, and as a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from semmap.api.map_questions import MapQuestions
from semmap.whole_file import write_whole

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

    def write_qgis_project(self, path: str | Path) -> Path:
        """Write a QGIS project: a floor plan of each storey whose layers edit the map.

        Its layers read the views ``semmap.gis_*`` of this database and know its address, but no
        password. They have symbols by type and state, labels, value lists and forms. Where the map
        has a georeference, they lie there on the earth; else the project has no CRS. New types get
        their colours when it is written again.

        Parameters
        ----------
        path : ``.qgz``; a file that is there is replaced

        Raises
        ------
        ValueError
            The ending is another one.

        See Also
        --------
        store_qgis_project : keep it in the database
        """
        path = Path(path)
        if path.suffix.lower() != ".qgz":
            raise ValueError(f"{path.name}: a QGIS project is a .qgz, not {path.suffix!r}")
        write_whole(path, self._qgis_project())
        return path

    def store_qgis_project(self) -> str:
        """Keep the QGIS project and default styles in the database; return the project's address.

        QGIS opens the address, or lists the project below the connection. It takes no socket's
        folder in an address: start it with ``PGHOST=/folder``. They are in the tables
        ``qgis_projects`` and ``layer_styles`` of the schema ``public``, which QGIS makes, too. A
        view of this map that is added to another project is drawn and edited in the same way.

        Raises
        ------
        PermissionError
            The user may not make or write these tables.
        """
        from semmap.draw.qgis.layers import default_layers
        from semmap.draw.qgis.project import project_address, style_file
        from semmap.query.gis_project import read_contents, store_project

        layers = default_layers(read_contents(self._seen).types)
        styles = {
            layer.view: ("Line" if layer.key == "connector" else "Polygon", style_file(layer))
            for layer in layers
        }
        store_project(self._seen, self._qgis_project(), styles)
        return project_address(self._seen.name, self._server)

    def _qgis_project(self) -> bytes:
        from semmap.draw.qgis.layers import StoreyGroup
        from semmap.draw.qgis.project import project_file
        from semmap.ingest.georeference import frame_crs
        from semmap.query.gis_project import read_contents

        found = read_contents(self._seen)
        return project_file(
            self._seen.name,
            [StoreyGroup(*row) for row in found.storeys],
            found.types,
            self._server,
            section_height=found.section_height,
            frame=(frame_crs(*found.georeference) if found.georeference else None) or "",
        )

    @property
    def _server(self) -> dict[str, str]:
        """libpq's parameters of the database, without the password."""
        info = self._seen.session.info
        here = {"host": info.host, "port": str(info.port), "user": info.user, "dbname": info.dbname}
        return info.get_parameters() | here

    def export(
        self, path: str | Path, *, crs: int | str | None = None, meshes: bool = True
    ) -> Path:
        """Write storeys, rooms, doors, regions and objects to a file of the format of its ending.

        `Map.import_file` reads GeoPackage, GeoJSON, SDF and IndoorGML back as the same map: names,
        types, labels, outlines, heights, poses, meshes, properties, and of doors the places that
        they join, state, direction, behaviour, width, height, step and permissions. Not so the
        poses before doors (they are chosen again), history, beliefs, statements, fields and links.

        Parameters
        ----------
        path : ``.gpkg``: a layer for each kind; ``.geojson``: one collection; ``.sdf``, ``.world``:
            a world of Gazebo; ``.gml``: IndoorGML 1.1; ``.yaml``: a ``building.yaml`` of Open-RMF;
            ``.glb``, ``.gltf``: a scene for viewers. A file that is there is replaced
        crs : coordinates in this CRS, for a map with a georeference: 4326 (longitude and latitude,
            for GeoJSON as RFC 7946 has them), or the EPSG code of a grid. By default metres of the
            map's frame
        meshes : write the meshes of objects, into a folder beside the file; otherwise an object is
            the prism of its footprint, in SDF a feature without a model

        Raises
        ------
        ValueError
            The ending is none of these, the CRS is unknown, or the map has no georeference.
        """
        from semmap.export.formats import export_map

        return export_map(self._seen, Path(path), crs=crs, meshes=meshes)
