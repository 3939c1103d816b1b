"""The georeference of a map: its frame on a grid of the earth, in metres."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.pose import Pose
from semmap.limits import EXTENT

if TYPE_CHECKING:
    from pyproj import Transformer

UTM_LATITUDES = (-80.0, 84.0)
"""Degrees between which UTM is defined."""

WGS84 = "EPSG:4326"

GRIDS = ("/usr/share/proj", "/usr/local/share/proj")
"""Folders with grids of old datums, which PostGIS uses and pyproj does not bring along: without
them, its answer is 1 m off for EPSG:31468."""

TRUE_SCALE = 0.01
"""By how much lengths on a grid may differ from those on the ground."""


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
    latitude: float, longitude: float, elevation: float = 0.0, heading: float = 0.0
) -> dict[str, float]:
    """Return the pose of a level frame at a place on the earth, on the UTM grid of that place.

    Latitude, longitude (WGS 84) and `heading` are degrees: the heading turns the frame from
    east-north-up about the downward axis, as of SDF's ``spherical_coordinates``: at 90 its x axis
    points south. Of the pose, `crs` is an EPSG code; `easting`, `northing` and `height` are metres;
    `rotation` is of the x axis from the grid's east, radians in [-pi, pi], counter-clockwise, with
    the grid's convergence, but not its scale, within 0.1 % of 1.
    """
    from pyproj import Proj

    crs = utm_crs(latitude, longitude)
    grid = Proj(f"EPSG:{crs}")
    easting, northing = grid(longitude, latitude)
    convergence = grid.get_factors(longitude, latitude).meridian_convergence
    return {
        "crs": crs,
        "easting": easting,
        "northing": northing,
        "height": elevation,
        "rotation": -math.remainder(math.radians(heading - convergence), math.tau),
    }


def to_degrees(georeference: Mapping[str, float]) -> dict[str, float]:
    """Return what `on_utm` takes, by the names of SDF, of a georeference on any grid."""
    from pyproj import CRS, Proj

    longitude, latitude = _between(int(georeference["crs"]), WGS84).transform(
        georeference["easting"], georeference["northing"]
    )
    grid = Proj(CRS.from_epsg(int(georeference["crs"])))
    convergence = grid.get_factors(longitude, latitude).meridian_convergence
    heading = convergence - math.degrees(georeference["rotation"])
    return {
        "latitude_deg": latitude,
        "longitude_deg": longitude,
        "elevation": georeference["height"],
        "heading_deg": math.remainder(heading, 360.0),
    }


def ground_scale(points: NDArray[np.float64], crs: Any) -> float:
    """Return the units of a CRS to a metre on the ground in the middle of points (N, 2) in it.

    Where they differ by direction, those furthest from 1; not finite for degrees. UTM has 1 within
    0.3 %, Web Mercator 1.6 at a latitude of 52 degrees (Snyder 1987, chapter 4).
    """
    from pyproj import CRS, Proj

    given = CRS.from_user_input(crs)
    if not given.is_projected:
        return math.nan
    longitude, latitude = _between(given, WGS84).transform(*np.median(points, axis=0))
    factors = Proj(given).get_factors(longitude, latitude)
    along = np.array([factors.tissot_semimajor, factors.tissot_semiminor])
    along /= given.axis_info[0].unit_conversion_factor
    return float(along[np.argmax(np.abs(along - 1))])


def scale_note(points: NDArray[np.float64], crs: Any) -> list[str]:
    """Return a note on a CRS in which lengths at points (N, 2) are not those on the ground."""
    scale = ground_scale(points, crs)
    if not abs(scale - 1) > TRUE_SCALE:
        return []
    return [
        f"lengths in {crs_name(crs)} are {scale:.2f} times those on the ground there: UTM is used "
        "instead"
    ]


def crs_name(crs: Any) -> str:
    """Return the code of a CRS, else its name.

    >>> crs_name("urn:ogc:def:crs:EPSG::2263")
    'EPSG:2263'
    """
    from pyproj import CRS

    given = CRS.from_user_input(crs)
    code = given.to_authority()
    return given.name if code is None else ":".join(code)


def frame_of(points: NDArray[np.float64], crs: Any) -> dict[str, float]:
    """Return a georeference for points (N, 2) of a CRS: their lowest whole metres on a grid.

    The grid is that of the CRS if its units are metres on the ground there, within 1 %, else UTM;
    x points along the grid. Points far from the others do not count.
    """
    from pyproj import CRS

    given = CRS.from_user_input(crs)
    true = abs(ground_scale(points, given) - 1) <= TRUE_SCALE
    code = given.to_epsg() if true else None
    if code is None:
        longitude, latitude = _between(given, WGS84).transform(*np.median(points, axis=0))
        code = utm_crs(latitude, longitude)
    at = np.column_stack(_between(given, code).transform(*points.T))
    easting, northing = lowest(at)
    return {"crs": code, "easting": easting, "northing": northing, "height": 0.0, "rotation": 0.0}


def lowest(points: NDArray[np.float64]) -> tuple[float, float]:
    """Return the lowest whole units of points (N, 2), without those that are far away."""
    near = (np.abs(points - np.median(points, axis=0)) <= EXTENT.value).all(axis=1)
    x, y = np.floor((points[near] if near.any() else points).min(axis=0)).tolist()
    return x, y


def on_true_scale(georeference: Mapping[str, float]) -> dict[str, float]:
    """Return a georeference whose grid has metres on the ground: itself, or the same on UTM."""
    origin = np.array([[georeference["easting"], georeference["northing"]]])
    if abs(ground_scale(origin, int(georeference["crs"])) - 1) <= TRUE_SCALE:
        return dict(georeference)
    return on_utm(*to_degrees(georeference).values())


def into_frame(
    points: NDArray[np.float64], crs: Any, georeference: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return points (N, 2) of a CRS, x or longitude first, in the frame of a map, metres.

    A point that the map's grid does not reach is not finite.
    """
    x, y = _between(crs, int(georeference["crs"])).transform(*points.T)
    east, north = x - georeference["easting"], y - georeference["northing"]
    cos, sin = math.cos(georeference["rotation"]), math.sin(georeference["rotation"])
    with np.errstate(invalid="ignore"):
        return np.column_stack([cos * east + sin * north, cos * north - sin * east])


def heights_into_frame(
    heights: NDArray[np.float64], crs: Any, georeference: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return heights in the units of a CRS in the frame of a map, metres.

    Without a vertical axis, their unit is that of the grid. The level from which they are counted
    is taken for that of the map's `height`.
    """
    from pyproj import CRS

    given = CRS.from_user_input(crs)
    axes = given.axis_info
    upright = [axis for axis in axes if axis.direction in ("up", "down")]
    unit = (upright or axes)[0].unit_conversion_factor if upright or given.is_projected else 1.0
    sign = -1.0 if upright and upright[0].direction == "down" else 1.0
    return sign * unit * heights - georeference["height"]


def on_grid(georeference: Mapping[str, float]) -> dict[str, float]:
    """Return a georeference on a grid: itself, or what `on_utm` makes of degrees."""
    if "crs" in georeference:
        return dict(georeference)
    place = ("latitude_deg", "longitude_deg", "elevation", "heading_deg")
    return on_utm(*(georeference.get(key, 0.0) for key in place))


def frame_in_frame(given: Mapping[str, float], other: Mapping[str, float]) -> Pose:
    """Return the pose of the frame of a georeference in that of another.

    Both are level; lengths on grids of two CRSs differ by less than `TRUE_SCALE`.
    """
    x_axis = np.array([(0.0, 0.0), (100.0, 0.0)])
    grid = int(given["crs"])
    (x, y), (far_x, far_y) = into_frame(out_of_frame(x_axis, grid, given), grid, other)
    yaw = math.atan2(far_y - y, far_x - x)
    return Pose.planar(float(x), float(y), yaw, given["height"] - other["height"])


def out_of_frame(
    points: NDArray[np.float64], crs: Any, georeference: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return points (N, 2) in the frame of a map, metres, in a CRS, x or longitude first."""
    x, y = points.T
    cos, sin = math.cos(georeference["rotation"]), math.sin(georeference["rotation"])
    east = georeference["easting"] + cos * x - sin * y
    north = georeference["northing"] + sin * x + cos * y
    return np.column_stack(_between(int(georeference["crs"]), crs).transform(east, north))


def northing_first(crs: str) -> bool:
    """Return whether coordinates under the URN or URL of a CRS have the northing first, as GML."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        axes = CRS.from_user_input(crs).axis_info
    except CRSError:
        return False
    return crs.startswith(("urn:", "http")) and bool(axes) and axes[0].direction == "north"


@cache
def _between(crs: Any, other: Any) -> Transformer:
    """The transformation from a CRS to another, x or longitude first."""
    from pyproj import Transformer, datadir

    for folder in GRIDS:
        if Path(folder).is_dir() and folder not in datadir.get_data_dir():
            datadir.append_data_dir(folder)
    return Transformer.from_crs(crs, other, always_xy=True)


def frame_crs(crs: int, easting: float, northing: float, rotation: float) -> str | None:
    """Return the frame of a georeferenced map as a CRS in WKT; None on a grid not in metres.

    It is derived from the grid of the EPSG code `crs` by shifting and turning, so that programs
    transform the map's coordinates, in metres, to and from other CRSs.
    """
    from pyproj import CRS

    grid = CRS(crs)
    if not grid.is_projected or any(axis.unit_conversion_factor != 1 for axis in grid.axis_info):
        return None
    # Under another name: by its own, PROJ looks up the order of its axes, which may be north first.
    stated = grid.to_wkt("WKT2_2019").replace(f'"{grid.name}"', '"grid of the map"', 1)
    base = "BASEPROJCRS" + stated.removeprefix("PROJCRS").partition("CS[")[0]
    c, s = math.cos(rotation), math.sin(rotation)
    parameters = {  # of x = A0 + A1 easting + A2 northing, y = B0 + B1 easting + B2 northing
        "A0": -(c * easting + s * northing),
        "A1": c,
        "A2": s,
        "B0": s * easting - c * northing,
        "B1": -s,
        "B2": c,
    }
    units = {"0": 'LENGTHUNIT["metre",1]', "1": 'SCALEUNIT["coefficient",1]'}
    values = ",".join(
        f'PARAMETER["{name}",{value!r},{units.get(name[1], units["1"])}]'
        for name, value in parameters.items()
    )
    axes = ",".join(
        f'AXIS["{axis}",unspecified,ORDER[{order}],LENGTHUNIT["metre",1]]'
        for order, axis in enumerate("xy", 1)
    )
    method = 'METHOD["Affine parametric transformation",ID["EPSG",9624]]'
    return (
        f'DERIVEDPROJCRS["frame of the map",{base.rstrip().rstrip(",")}],'
        f'DERIVINGCONVERSION["frame of the map",{method},{values}],CS[Cartesian,2],{axes}]'
    )
