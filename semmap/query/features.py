"""Entities as GeoJSON features (RFC 7946, but metres in the map's frame)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import shapely


def feature(row: Mapping[str, Any]) -> dict[str, Any]:
    """The Feature of a row of `semmap.query.shapes.read_shapes`; free properties come along."""
    shown = {k: v for k, v in row.items() if k not in ("id", "geometry", "properties")}
    if row["kind"] != "connector":
        del shown["state"]
    geometry = row["geometry"]
    return {
        "type": "Feature",
        "id": row["id"],
        "geometry": None if geometry is None else shapely.geometry.mapping(geometry),
        "properties": {**row["properties"], **shown},
        **({} if geometry is None else {"bbox": geometry.bounds}),
    }


def feature_collection(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """The FeatureCollection of rows of `semmap.query.shapes.read_shapes`."""
    return {"type": "FeatureCollection", "features": [feature(row) for row in rows]}
