"""The georeference of a map: a place on the earth, from degrees to a UTM grid."""

from __future__ import annotations

import math
from typing import Any

import psycopg

UTM_LATITUDES = (-80.0, 84.0)
"""Degrees between which UTM is defined."""


def utm_crs(latitude: float, longitude: float) -> int:
    """Return the EPSG code of the UTM zone (WGS 84) of a place given in degrees.

    Zones are 6° wide everywhere, also around Norway and Svalbard: a map must lie near one grid, not
    on the sheet that printed maps use. A ValueError refuses a latitude beyond those of UTM.
    """
    low, high = UTM_LATITUDES
    if not low <= latitude <= high:
        raise ValueError(
            f"latitude {latitude:g}° is beyond UTM; give one from {low:g} to {high:g} degrees"
        )
    zone = int((longitude + 180) % 360 // 6) + 1
    return (32600 if latitude >= 0 else 32700) + zone


def on_utm(
    cursor: psycopg.Cursor[Any],
    latitude: float,
    longitude: float,
    elevation: float = 0.0,
    heading: float = 0.0,
) -> dict[str, float]:
    """Return the pose of a level frame at a place on the earth, on the UTM grid of that place.

    Latitude, longitude (WGS 84) and `heading` are degrees: the heading turns the frame from
    east-north-up about the downward axis, as of SDF's ``spherical_coordinates``: at 90 its x axis
    points south. Of the pose, `crs` is an EPSG code; `easting`, `northing` and `height` are metres;
    `rotation` is of the x axis from the grid's east, radians in [-pi, pi], counter-clockwise, with
    the grid's convergence, but not its scale, within 0.1 % of 1.
    """
    crs = utm_crs(latitude, longitude)
    cursor.execute(
        "SELECT ST_X(here), ST_Y(here), ST_X(north) - ST_X(here), ST_Y(north) - ST_Y(here) FROM "
        "ST_Transform(ST_SetSRID(ST_MakePoint(%(lon)s, %(lat)s), 4326), %(crs)s::int) AS here, "
        "ST_Transform(ST_SetSRID(ST_MakePoint(%(lon)s, %(lat)s + 1e-4), 4326), %(crs)s::int) north",
        {"lat": latitude, "lon": longitude, "crs": crs},
    )
    row = cursor.fetchone()
    assert row is not None
    easting, northing, north_x, north_y = row
    convergence = math.atan2(north_x, north_y)  # of true north from the grid's, clockwise
    return {
        "crs": crs,
        "easting": easting,
        "northing": northing,
        "height": elevation,
        "rotation": -math.remainder(math.radians(heading) + convergence, math.tau),
    }
