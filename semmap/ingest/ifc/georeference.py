"""Where on the earth an IFC building stands."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from semmap.ingest.georeference import on_true_scale, scale_note
from semmap.ingest.ifc.building import IfcBuilding

FAR = 1.0
"""Degrees beyond the area of a grid within which a building may use it."""


def georeference_of(building: IfcBuilding) -> dict[str, Any] | None:
    """Return the georeference of a file as of a `World`; None where it states none.

    `IfcMapConversion` has the origin in a grid; else `IfcSite` has degrees, and the context the
    direction of true north.
    """
    file = building.file
    for conversion in file.of("IfcMapConversion"):
        code = re.search(r"EPSG\D*(\d+)", str(conversion.TargetCRS.Name), re.IGNORECASE)
        if code is None:
            building.out.notes.append(
                f"georeference left out: {conversion.TargetCRS.Name!r} is no EPSG code"
            )
            continue
        east, north = conversion.XAxisAbscissa, conversion.XAxisOrdinate
        try:
            has_unit = conversion.TargetCRS.MapUnit
            unit = 1.0 if has_unit else _map_unit(conversion, code[1], file.metres)
            stated = {
                "crs": int(code[1]),
                "easting": conversion.Eastings * unit,
                "northing": conversion.Northings * unit,
                "height": (conversion.OrthogonalHeight or 0.0) * unit,
                "rotation": math.atan2(north or 0.0, 1.0 if east is None else east),
            }
            origin = np.array([[stated["easting"], stated["northing"]]])
            building.out.notes += scale_note(origin, f"EPSG:{stated['crs']}")
            return on_true_scale(stated)
        except (ValueError, RuntimeError) as error:  # beyond UTM; pyproj
            building.out.notes.append(f"georeference left out: {error}")
    for site in file.of("IfcSite"):
        if site.RefLatitude and site.RefLongitude:
            north = _true_north(file.of("IfcGeometricRepresentationContext"))
            return {
                "latitude_deg": _degrees(site.RefLatitude),
                "longitude_deg": _degrees(site.RefLongitude),
                "elevation": (site.RefElevation or 0.0) * file.metres,
                "heading_deg": math.degrees(math.atan2(-north[0], north[1])),
            }
    return None


def _map_unit(conversion: Any, code: str, metres: float) -> float:
    """Metres of the unit of a grid of which the file states none.

    By ISO 16739 it is that of the project, `metres`. Many files of millimetres have metres there:
    so it is where the project's unit is far away from where the grid is used, and metres are not.
    """
    from pyproj import CRS, Transformer

    crs = CRS.from_epsg(code)
    to_degrees = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
    for unit in (metres, 1.0):
        at = to_degrees.transform(conversion.Eastings * unit, conversion.Northings * unit)
        used = crs.area_of_use
        if used is None or shapely.box(*used.bounds).dwithin(shapely.Point(at), FAR):
            return unit
    return metres


def _degrees(parts: Sequence[int]) -> float:
    """Degrees of an `IfcCompoundPlaneAngleMeasure`: degrees, minutes, seconds, millionths.

    >>> _degrees((-87, -38, -24))
    -87.64
    """
    factors = (1, 60, 3600, 3600e6)
    return round(sum(part / factor for part, factor in zip(parts, factors, strict=False)), 10)


def _true_north(contexts: Sequence[Any]) -> tuple[float, float]:
    for context in contexts:
        if context.is_a() == "IfcGeometricRepresentationContext" and context.TrueNorth:
            x, y = context.TrueNorth.DirectionRatios[:2]
            return float(x), float(y)
    return 0.0, 1.0
