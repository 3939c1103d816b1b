"""The functions of GeoSPARQL 1.1 as functions of PostGIS.

A literal without a reference system is in the map's frame, whose unit is the metre. Of literals
with one, lengths and areas are those on the ellipsoid, where the system is not one of metres. A map
with a georeference relates its frame to them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from rdflib.plugins.sparql.parserutils import CompValue

from semmap.knowledge.mapping import DATATYPES, TOPOLOGICAL
from semmap.knowledge.triple_map import Form, Value
from semmap.knowledge.vocabulary import GEOF, SEMMAP, SF


@dataclass(frozen=True)
class GeoFunction:
    """A function of literals."""

    name: str  # as errors write it
    sql: str  # with {0}, {1} ... for the arguments
    # "geometry", "number", "text", "time", "entity", "voxel", "literal"; of units "length", "area"
    arguments: tuple[str, ...]
    result: Form  # the form of the result
    optional: int = 0  # how many of the last arguments may be left out
    metric: str = ""  # the same in metres, with the metres of a unit for its argument

    @property
    def counts(self) -> range:
        """How many arguments it takes."""
        return range(len(self.arguments) - self.optional, len(self.arguments) + 1)


_ONE, _TWO = ("geometry",), ("geometry", "geometry")
_DISTANCE = "ground_measure({0}, 'distance', {1}, {map})"
_AREA, _LENGTH, _PERIMETER = (
    f"ground_measure({{0}}, '{what}')" for what in ("area", "length", "perimeter")
)
_ON_PLANE = {
    _DISTANCE: "ST_Distance({0}, {1})",
    _AREA: "ST_Area({0})",
    _LENGTH: "ST_Length({0})",
    _PERIMETER: "ST_Perimeter({0})",
}
_SYSTEM = "CASE WHEN text_geometry({0}) IS NOT NULL THEN coalesce(literal_system({0}), '') END"

_TABLE: tuple[tuple[Any, ...], ...] = (
    # Non-topological functions (GeoSPARQL 1.1, section 10.8)
    (
        "distance",
        "ST_Distance({0}, {1})",
        (*_TWO, "length"),
        "double",
        1,
        f"{_DISTANCE} / {{2}}",
    ),
    ("metricDistance", _DISTANCE, _TWO, "double", 0),
    (
        "buffer",
        "ST_Buffer({0}, {1})",
        ("geometry", "number", "length"),
        "geometry",
        1,
        "ground_buffer({0}, {1} * {2})",
    ),
    ("metricBuffer", "ground_buffer({0}, {1})", ("geometry", "number"), "geometry", 0),
    ("convexHull", "ST_ConvexHull({0})", _ONE, "geometry", 0),
    ("concaveHull", "ST_ConcaveHull({0}, 0.8)", _ONE, "geometry", 0),
    ("intersection", "ST_Intersection({0}, {1})", _TWO, "geometry", 0),
    ("union", "ST_Union({0}, {1})", _TWO, "geometry", 0),
    ("difference", "ST_Difference({0}, {1})", _TWO, "geometry", 0),
    ("symDifference", "ST_SymDifference({0}, {1})", _TWO, "geometry", 0),
    ("envelope", "ST_Envelope({0})", _ONE, "geometry", 0),
    ("boundary", "ST_Boundary({0})", _ONE, "geometry", 0),
    ("boundingCircle", "ST_MinimumBoundingCircle({0})", _ONE, "geometry", 0),
    ("centroid", "ST_Centroid({0})", _ONE, "geometry", 0),
    ("area", "ST_Area({0})", (*_ONE, "area"), "double", 1, f"{_AREA} / {{1}}"),
    ("metricArea", _AREA, _ONE, "double", 0),
    ("length", "ST_Length({0})", (*_ONE, "length"), "double", 1, f"{_LENGTH} / {{1}}"),
    ("metricLength", _LENGTH, _ONE, "double", 0),
    ("perimeter", "ST_Perimeter({0})", (*_ONE, "length"), "double", 1, f"{_PERIMETER} / {{1}}"),
    ("metricPerimeter", _PERIMETER, _ONE, "double", 0),
    ("minX", "ST_XMin({0})", _ONE, "double", 0),
    ("minY", "ST_YMin({0})", _ONE, "double", 0),
    ("minZ", "ST_ZMin({0})", _ONE, "double", 0),
    ("maxX", "ST_XMax({0})", _ONE, "double", 0),
    ("maxY", "ST_YMax({0})", _ONE, "double", 0),
    ("maxZ", "ST_ZMax({0})", _ONE, "double", 0),
    ("dimension", "ST_Dimension({0})", _ONE, "integer", 0),
    ("coordinateDimension", "ST_CoordDim({0})::int", _ONE, "integer", 0),
    ("spatialDimension", "ST_CoordDim({0})::int", _ONE, "integer", 0),
    ("isEmpty", "ST_IsEmpty({0})", _ONE, "boolean", 0),
    ("isSimple", "ST_IsSimple({0})", _ONE, "boolean", 0),
    ("is3D", "ST_CoordDim({0}) = 3", _ONE, "boolean", 0),
    ("isMeasured", "ST_Zmflag({0}) IN (1, 3)", _ONE, "boolean", 0),
    ("numGeometries", "ST_NumGeometries({0})", _ONE, "integer", 0),
    ("geometryN", "ST_GeometryN({0}, ({1})::int)", ("geometry", "number"), "geometry", 0),
    ("geometryType", f"'{SF}' || substr(ST_GeometryType({{0}}), 4)", _ONE, "iri", 0),
    ("getSRID", _SYSTEM, ("literal",), "string", 0),
    ("transform", "in_system({0}, {1}, {map})", ("geometry", "text"), "geometry", 0),
    ("relate", "ST_Relate({0}, {1}, {2})", (*_TWO, "text"), "boolean", 0),
    ("asWKT", "{0}", _ONE, "geometry", 0),
    ("asGML", "geometry_gml({0})", (*_ONE, "text"), "gml", 1),
    ("asGeoJSON", "geometry_json({0})", _ONE, "geojson", 0),
)

_OWN: tuple[tuple[str, str, tuple[str, ...], Form], ...] = (
    (
        "distance",
        "surface_distance({0}, {1})",
        ("entity", "entity"),
        "double",
    ),
    (
        "positionAt",
        "SELECT ST_MakePoint(p.pose[1], p.pose[2], p.pose[3]) FROM pose_at({0}, {1}) p (pose) "
        "WHERE p.pose IS NOT NULL",
        ("entity", "time"),
        "geometry",
    ),
    ("x", "(split_part({0}, ',', 1)::int + 0.5) * 0.05", ("voxel",), "double"),
    ("y", "(split_part({0}, ',', 2)::int + 0.5) * 0.05", ("voxel",), "double"),
    ("z", "(split_part({0}, ',', 3)::int + 0.5) * 0.05", ("voxel",), "double"),
    ("distance3D", "ST_3DDistance({0}, {1})", _TWO, "double"),
)

_TOPOLOGICAL = (
    (name, sql.format(a="{0}", b="{1}"), _TWO, "boolean") for name, sql in TOPOLOGICAL.items()
)

FUNCTIONS: Mapping[str, GeoFunction] = {
    **{f"{GEOF}{row[0]}": GeoFunction(f"geof:{row[0]}", *row[1:]) for row in _TABLE},
    **{f"{GEOF}{row[0]}": GeoFunction(f"geof:{row[0]}", *row[1:]) for row in _TOPOLOGICAL},
    **{f"{SEMMAP}{row[0]}": GeoFunction(f"semmap:{row[0]}", *row[1:]) for row in _OWN},
}
"""By IRI; `semmap:distance` is that of the surfaces of two entities, in metres, and
`semmap:positionAt` where an entity was at a time; `semmap:x`, `y` and `z` are those of the centre
of a voxel."""

_GROUP = "put_together(array_agg({0}), {map})"

AGGREGATES: Mapping[str, str] = {
    "aggBoundingBox": f"ST_Envelope({_GROUP})",
    "aggBoundingCircle": f"ST_MinimumBoundingCircle({_GROUP})",
    "aggCentroid": f"ST_Centroid({_GROUP})",
    "aggConcaveHull": f"ST_ConcaveHull({_GROUP}, 0.8)",
    "aggConvexHull": f"ST_ConvexHull({_GROUP})",
    "aggUnion": f"ST_UnaryUnion({_GROUP})",
}
"""The functions of `geof:` that make one geometry of those of a group."""

_PLAIN = re.compile(r"\s*(MULTI)?(POINT|LINESTRING|POLYGON)\s*\([-+.,() \d]+\)\s*$", re.ASCII)
"""WKT that PostGIS and GEOS read alike."""

_TURNED = str.maketrans("<>", "><")
_UOM, _QUDT = "http://www.opengis.net/def/uom/OGC/1.0/", "http://qudt.org/vocab/unit/"

UNITS: Mapping[str, Mapping[str, float]] = {
    "length": {
        f"{_UOM}metre": 1.0,
        f"{_QUDT}M": 1.0,
        f"{_QUDT}KiloM": 1000.0,
        f"{_QUDT}CentiM": 0.01,
        f"{_QUDT}MilliM": 0.001,
        f"{_QUDT}IN": 0.0254,
        f"{_QUDT}FT": 0.3048,
        f"{_QUDT}YD": 0.9144,
        f"{_QUDT}MI": 1609.344,
    },
    "area": {
        f"{_UOM}squareMetre": 1.0,
        f"{_UOM}metre": 1.0,
        f"{_QUDT}M2": 1.0,
        f"{_QUDT}KiloM2": 1e6,
        f"{_QUDT}CentiM2": 1e-4,
        f"{_QUDT}MilliM2": 1e-6,
        f"{_QUDT}HA": 1e4,
        f"{_QUDT}FT2": 0.09290304,
        f"{_QUDT}AC": 4046.8564224,
    },
    "angle": {
        f"{_UOM}degree": 1.0,
        f"{_QUDT}DEG": 1.0,
        f"{_UOM}radian": 57.29577951308232,
        f"{_QUDT}RAD": 57.29577951308232,
    },
}
"""Units in metres, square metres and degrees."""

_DISTANCES = {f"{GEOF}distance", f"{GEOF}metricDistance"}


def geometry_of(value: Value) -> str:
    """Return the SQL of a geometry literal; null for other terms."""
    if value.form == "geometry":
        return value.sql
    if value.form in ("gml", "geojson"):
        return f"text_geometry({value.sql}, '{DATATYPES[value.form]}')"
    if value.form == "term":
        return f"text_geometry({value.sql}, {value.tag})"
    return "NULL::geometry"


def surface_comparison(a: Value, operator: str, b: Value) -> str | None:
    """Return the SQL of `semmap:distance(x, y) < d`, which needs no distance; None for others."""
    if a.between is None:
        a, operator, b = b, operator.translate(_TURNED), a
    if a.between is None:
        return None
    farther = "NOT " if ">" in operator else ""
    or_equal = operator in ("<=", ">")
    return f"({farther}is_nearer({', '.join(a.between)}, {b.sql}, {str(or_equal).lower()}))"


def within_distance(
    tree: CompValue, value: Callable[[Any], Value], number: Callable[[Value], str], map_id: str
) -> str | None:
    """Return a condition that the index of footprints answers, for `geof:distance(a, b) < d`."""
    near, far = (tree.expr, tree.other) if tree.op in ("<", "<=") else (tree.other, tree.expr)
    if getattr(near, "name", "") != "Function" or str(near.iri) not in _DISTANCES:
        return None
    ends = sorted((geometry_of(value(each)) for each in near.expr[:2]), key=_is_footprint)
    factor = 1.0 if len(near.expr) < 3 else UNITS["length"].get(str(near.expr[2]))
    if not _is_footprint(ends[1]) or factor is None:
        return None
    placed, _ = in_one_system(ends[0], ends[1], map_id)
    return f"({ends[1]} && ST_Expand({placed}, {number(value(far))} * {factor!r}))"


def literal_geometry(text: str, tag: str, bind: Callable[..., str]) -> str:
    """Return the SQL of a WKT literal: a value, where it has points and lines of a plane only.

    The function that reads others is called once, not for each row.
    """
    import shapely  # here, as it takes as long to load as a short command

    if _PLAIN.match(text):
        with suppress(shapely.GEOSException):
            shape = shapely.from_wkt(text)
            if shape.is_valid:  # of others, PostGIS refuses some
                return bind(shapely.to_wkb(shape, hex=True), "geometry")
    return f"(SELECT text_geometry({bind(text)}, {bind(tag)}))"


def in_one_system(a: str, b: str, map_id: str) -> tuple[str, str]:
    """Return two geometries in one reference system; the index of footprints is still seen."""
    if _is_in_frame(b):
        return a if _is_in_frame(a) else _placed(a, map_id), b
    return a, _placed(b, map_id) if _is_in_frame(a) else f"alike({b}, {a}, {map_id})"


def on_plane(sql: str, arguments: Sequence[str]) -> str:
    """Return the SQL of a function; measures of the plane where all is in the map's frame."""
    shapes = [each for n, each in enumerate(arguments) if f"{{{n}}}" in sql]
    if shapes and all(map(_is_in_frame, shapes)):
        for on_ground, plain in _ON_PLANE.items():
            sql = sql.replace(on_ground, plain)
    return sql


def _placed(sql: str, map_id: str) -> str:
    """Return a geometry in the frame of a map; a literal is placed once, not for each row."""
    placed = f"in_map_frame({sql}, {map_id})"
    return f"(SELECT {placed})" if sql.startswith("(SELECT text_geometry(") else placed


def _is_in_frame(sql: str) -> bool:
    """Return whether a geometry is a footprint, or a value that names no reference system."""
    return _is_footprint(sql) or re.fullmatch(r"%\(\w+\)s::geometry", sql) is not None


def _is_footprint(sql: str) -> bool:
    return re.fullmatch(r"\w+\.footprint", sql) is not None
