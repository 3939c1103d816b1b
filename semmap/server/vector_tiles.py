"""Vector tiles of a map for MapLibre, QGIS and others: a layer for each collection, by PostGIS.

Addresses are those of OGC API - Tiles, with the tile matrix set WebMercatorQuad. A map without a
georeference lies at 0 degrees north, 0 degrees east, its x axis to the east.
"""

from __future__ import annotations

from semmap.api.map import Map
from semmap.error import InvalidArgumentError
from semmap.query.entity_shapes import SHAPE, SHAPED
from semmap.server.ogc_features import COLLECTIONS, collection

MEDIA_TYPE = "application/vnd.mapbox-vector-tile"

DEEPEST = 24
"""The zoom of the smallest tiles: 2 m wide at the equator."""

WIDE = 10
"""The zoom of tiles of 40 km, from which on entities are picked in the frame of the map."""


def tile_of(map: Map, name: str, zoom: str, row: str, column: str) -> bytes:
    """The tile of a collection; UnknownNameError, InvalidArgumentError if there is no such one.

    Features have the `id` of items, `name`, `type`, `label`, `storey` and `state`.
    """
    kind = COLLECTIONS[collection("", name)["id"]]
    texts = (zoom, row, column)
    z, y, x = (int(t) if t.isdecimal() and len(t) < 10 else -1 for t in texts)
    if not 0 <= z <= DEEPEST or not (0 <= x < 2**z and 0 <= y < 2**z):
        raise InvalidArgumentError(
            f"no tile {'/'.join(texts)}: give zoom (0 to {DEEPEST}), row and column in it"
        )
    return b"".join(bytes(tile) for (tile,) in map.execute(_TILE, kind, name, z, x, y, z >= WIDE))


_TILE = f"""
WITH asked (kind, layer, z, x, y, near) AS (
    VALUES (%s::text, %s::text, %s::integer, %s::integer, %s::integer, %s)),
square AS (SELECT ST_TileEnvelope(z, x, y) AS outline FROM asked),
around AS (SELECT CASE WHEN m.crs IS NULL THEN ST_SetSRID(outline, 0)
    ELSE ST_SetSRID(ST_Rotate(ST_Translate(ST_Transform(ST_Segmentize(outline, 5e3), m.crs),
        -m.easting, -m.northing), -m.rotation), 0) END AS outline
    FROM asked, square, map m WHERE m.id = current_map() AND near),
shown AS (SELECT e.id, e.name, e.type, e.label, s.name AS storey, c.state,
    ST_Force2D({SHAPE}) AS shape
    FROM {SHAPED} WHERE e.map_id = current_map() AND e.kind = (SELECT kind FROM asked)
    AND (NOT (SELECT near FROM asked) OR w.box && (SELECT ST_Expand(outline, 1) FROM around))),
placed AS (SELECT i.*, coalesce(ST_Transform(on_earth(shape, current_map()), 3857),
    ST_SetSRID(shape, 3857)) AS mercator FROM shown i),
tile AS (SELECT id, name, type, label, storey, state, ST_AsMVTGeom(mercator, outline) AS geom
    FROM placed, square)
SELECT ST_AsMVT(tile.*, layer, 4096, 'geom', 'id') FROM tile, asked WHERE geom IS NOT NULL
GROUP BY layer
"""
