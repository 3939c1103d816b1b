"""The entities of a map as OGC API - Features, Part 1: Core (OGC 17-069r4), for QGIS and others.

Coordinates are longitude and latitude. A map without a georeference lies at 0 degrees north, 0
degrees east, its x axis to the east.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from semmap.api.map import Map
from semmap.error import InvalidArgumentError, UnknownNameError
from semmap.ingest.georeference import out_of_frame
from semmap.plain_values import plain
from semmap.query.entity_shapes import read_shapes

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from pyproj import Transformer

COLLECTIONS = {
    "rooms": "room",
    "doors": "connector",
    "objects": "object",
    "regions": "region",
    "storeys": "storey",
    "agents": "agent",
}
"""The collections of a map with the kinds of their entities."""

CLASSES = [
    f"http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/{each}" for each in ("core", "geojson")
]
"""The conformance classes."""

CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
MOST = 10_000
"""The most features of a page."""


def landing(base: str, title: str) -> dict[str, Any]:
    """The landing page of a map at an URL."""
    links = [
        ("self", base, "this document"),
        ("conformance", f"{base}/conformance", "conformance classes"),
        ("data", f"{base}/collections", "collections"),
        ("service-desc", f"{base}/openapi.json", "the API"),
    ]
    return {"title": title, "links": [_link(*each) for each in links]}


def collections(base: str) -> dict[str, Any]:
    """All collections of a map."""
    found = [collection(base, name) for name in COLLECTIONS]
    return {"links": [_link("self", f"{base}/collections", "")], "collections": found}


def collection(base: str, name: str) -> dict[str, Any]:
    """One collection; UnknownNameError if there is no such one."""
    if name not in COLLECTIONS:
        raise UnknownNameError(f"no collection {name}: there are {', '.join(COLLECTIONS)}")
    items = _link("items", f"{base}/collections/{name}/items", name, "application/geo+json")
    return {"id": name, "title": name, "itemType": "feature", "crs": [CRS84], "links": [items]}


def items(map: Map, name: str, base: str, asked: Mapping[str, str]) -> dict[str, Any]:
    """A page of the features of a collection: ``bbox``, ``limit``, ``offset``, and properties."""
    kind = COLLECTIONS[collection(base, name)["id"]]
    _check_time(asked.get("datetime", ".."))
    limit, offset = (_count(asked, key, value) for key, value in (("limit", 10), ("offset", 0)))
    found = [row for row in _features(map) if row["properties"]["kind"] == kind]
    if "bbox" in asked:
        box = _box(asked["bbox"])
        found = [row for row in found if row["shape"] is not None and box.intersects(row["shape"])]
    for key, value in asked.items():
        if key not in ("bbox", "limit", "offset", "f", "datetime"):
            found = [row for row in found if _is(row, key, value)]
    page = found[offset : offset + min(limit, MOST)]
    here = f"{base}/collections/{name}/items"
    links = [_link("self", here, name, "application/geo+json")]
    if offset + len(page) < len(found):
        rest = "".join(f"&{k}={v}" for k, v in asked.items() if k not in ("limit", "offset"))
        more = f"{here}?limit={limit}&offset={offset + len(page)}{rest}"
        links.append(_link("next", more, "the next page", "application/geo+json"))
    return {
        "type": "FeatureCollection",
        "numberMatched": len(found),
        "numberReturned": len(page),
        "links": links,
        "features": [_told(row) for row in page],
    }


def _check_time(text: str) -> None:
    """InvalidArgumentError for what is no time or interval; features of the present are in each."""
    try:
        for each in text.split("/", 1):
            if each not in ("", ".."):
                datetime.fromisoformat(each)
    except ValueError as error:
        raise InvalidArgumentError(
            f"datetime is {text!r}: give a time of RFC 3339, or A/B"
        ) from error


def item(map: Map, name: str, base: str, number: str) -> dict[str, Any]:
    """One feature by its id; UnknownNameError if the collection has none."""
    kind = COLLECTIONS[collection(base, name)["id"]]
    for row in _features(map):
        if str(row["id"]) == number and row["properties"]["kind"] == kind:
            links = [_link("collection", f"{base}/collections/{name}", name)]
            return _told(row) | {"links": links}
    raise UnknownNameError(f"no feature {number} in {name}")


def _features(map: Map) -> list[dict[str, Any]]:
    frames = map.execute(
        "SELECT crs, easting, northing, rotation FROM map WHERE id = current_map() "
        "AND crs IS NOT NULL"
    )
    names = ("crs", "easting", "northing", "rotation")
    frame = dict(zip(names, frames[0], strict=True)) if frames else None

    def moved(points: NDArray[np.float64]) -> NDArray[np.float64]:
        if frame is None:
            return np.column_stack(_at_the_origin().transform(*points.T))
        return out_of_frame(points, "OGC:CRS84", frame)

    with map.snapshot() as seen:
        rows = read_shapes(seen)
    found = []
    for row in rows:
        shape = row.pop("geometry")
        own = row.pop("properties") or {}
        number = row.pop("id")
        if shape is not None:
            shape = shapely.transform(shape, moved)
        found.append({"id": number, "shape": shape, "properties": {**own, **row}})
    return found


@cache
def _at_the_origin() -> Transformer:
    """From metres around 0 degrees north, 0 degrees east."""
    from pyproj import Transformer

    plane = "+proj=aeqd +lat_0=0 +lon_0=0 +datum=WGS84 +units=m"
    return Transformer.from_crs(plane, "OGC:CRS84", always_xy=True)


def _told(row: dict[str, Any]) -> dict[str, Any]:
    shape = row["shape"]
    return {
        "type": "Feature",
        "id": row["id"],
        "geometry": None if shape is None else shapely.geometry.mapping(shape),
        "properties": plain(row["properties"]),
    }


def _is(row: dict[str, Any], key: str, value: str) -> bool:
    if key not in row["properties"]:
        raise InvalidArgumentError(f"no parameter {key}: bbox, limit, offset, or a property")
    return str(row["properties"][key]) == value


def _count(asked: Mapping[str, str], key: str, default: int) -> int:
    text = asked.get(key, str(default))
    if not text.isdecimal() or len(text) > 9 or (key == "limit" and int(text) == 0):
        raise InvalidArgumentError(f"{key} is {text}: give a whole number")
    return int(text)


def _box(text: str) -> shapely.Polygon:
    try:
        values = [float(each) for each in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (4, 6) or not np.isfinite(values).all():
        raise InvalidArgumentError(f"bbox is {text}: give west,south,east,north in degrees")
    half = len(values) // 2
    return shapely.box(values[0], values[1], values[half], values[half + 1])


def _link(rel: str, href: str, title: str, kind: str = "application/json") -> dict[str, str]:
    return {"rel": rel, "href": href, "title": title, "type": kind}
