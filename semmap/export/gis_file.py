"""A map as GeoJSON or GeoPackage, as `semmap.ingest.annotation` reads it."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

from semmap.export.features import MapFeature, MapFeatures
from semmap.ingest.annotation.draft_world import NESTED
from semmap.ingest.annotation.feature_file import COORDINATES
from semmap.query.entity_shapes import geojson_feature

_RESERVED = {"fid", "geom", NESTED}
"""Columns of a GeoPackage that are not free properties."""


def collection(found: MapFeatures) -> dict[str, Any]:
    """Return the GeoJSON FeatureCollection of a map: RFC 7946, if its CRS is WGS 84."""
    made: dict[str, Any] = {"type": "FeatureCollection", "name": found.name}
    if found.georeference is not None:
        made["georeference"] = found.georeference
    if found.crs is not None:
        made[COORDINATES] = found.crs
        if found.crs != "EPSG:4326":  # which readers of older GeoJSON know
            made["crs"] = {"type": "name", "properties": {"name": found.crs}}
    made["features"] = [
        geojson_feature(_wound(each.geometry), each.properties) for each in found.all()
    ]
    return made


def _wound(geometry: shapely.Geometry | None) -> shapely.Geometry | None:
    """Return a geometry whose outer rings are counter-clockwise, as RFC 7946 asks."""
    if geometry is None or geometry.geom_type not in ("Polygon", "MultiPolygon"):
        return geometry
    return shapely.reverse(shapely.normalize(geometry))


def write_geojson(found: MapFeatures, path: Path) -> None:
    """Write a map as a GeoJSON FeatureCollection."""
    path.write_text(json.dumps(collection(found), ensure_ascii=False), encoding="utf-8")


def write_geopackage(found: MapFeatures, path: Path) -> None:
    """Write a map as a GeoPackage with a layer for each kind."""
    if not found.layers:
        raise ValueError(f"the map {found.name} has no entities, and a GeoPackage has layers")
    about = None
    if found.georeference is not None:
        about = {"georeference": json.dumps(found.georeference)}
    for layer, features in found.layers.items():
        columns = _columns(features)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a map's frame has no CRS
            pyogrio.raw.write(
                path,
                np.array([shapely.to_wkb(each.geometry) for each in features], dtype=object),
                [_column(values) for values in columns.values()],
                [*columns],
                field_mask=[np.array([v is None for v in values]) for values in columns.values()],
                layer=layer,
                driver="GPKG",
                geometry_type="Unknown",
                crs=found.crs,
                append=path.exists(),
                layer_options={"FID": "fid"},
                dataset_metadata=None if path.exists() else about,
            )


def _columns(features: list[MapFeature]) -> dict[str, list[Any]]:
    """Return the columns of a layer: keys, and free properties that a column can hold.

    The others are in one column, as JSON: those of several types, lists and objects, and names that
    SQLite takes for that of another column.
    """
    every = [each.properties for each in features]
    keys = dict.fromkeys(key for each in features for key in each.keys)
    columns = {key: [given.get(key) for given in every] for key in keys}
    taken = {*map(str.lower, columns), *_RESERVED}
    for key in dict.fromkeys(key for given in every for key in given if key not in columns):
        values = [given.get(key) for given in every]
        if key and key.lower() not in taken and _dtype(values) is not None:
            columns[key] = values
            taken.add(key.lower())
    rest = [
        {
            **{k: v for k, v in given.items() if k not in columns and k != NESTED},
            **given.get(NESTED, {}),
        }
        for given in every
    ]
    if any(rest):
        columns[NESTED] = [each or None for each in rest]
    return columns


def _dtype(values: list[Any]) -> type | None:
    """Return the type of a column for values, None where none keeps them."""
    types = {type(value) for value in values if value is not None}
    if types <= {str}:
        return object
    if types == {bool}:
        return np.bool_
    if not types <= {int, float} or max(abs(v) for v in values if v is not None) >= 2**53:
        return None
    return np.int64 if types == {int} else np.float64


def _column(values: list[Any]) -> NDArray[Any]:
    """Return the values of a column; lists and objects as JSON."""
    dtype = _dtype(values)
    if dtype is None or dtype is object:
        texts = [v if isinstance(v, str | None) else json.dumps(v) for v in values]
        return np.array(texts, dtype=object)
    return np.array([0 if v is None else v for v in values], dtype=dtype)
