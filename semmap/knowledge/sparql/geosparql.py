"""The functions of GeoSPARQL 1.1 as functions of PostGIS; maps are metric, units are metres."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
    arguments: tuple[str, ...]  # "geometry", "number", "text", "time", "entity" or "voxel"
    result: Form  # the form of the result
    optional: int = 0  # how many of the last arguments may be left out

    @property
    def counts(self) -> range:
        """How many arguments it takes."""
        return range(len(self.arguments) - self.optional, len(self.arguments) + 1)


_ONE, _TWO = ("geometry",), ("geometry", "geometry")

_TABLE: tuple[tuple[str, str, tuple[str, ...], Form, int], ...] = (
    # Non-topological functions (GeoSPARQL 1.1, section 10.8)
    ("distance", "ST_Distance({0}, {1})", (*_TWO, "text"), "double", 1),
    ("metricDistance", "ST_Distance({0}, {1})", _TWO, "double", 0),
    ("buffer", "ST_Buffer({0}, {1})", ("geometry", "number", "text"), "geometry", 1),
    ("metricBuffer", "ST_Buffer({0}, {1})", ("geometry", "number"), "geometry", 0),
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
    ("area", "ST_Area({0})", (*_ONE, "text"), "double", 1),
    ("metricArea", "ST_Area({0})", _ONE, "double", 0),
    ("length", "ST_Length({0})", (*_ONE, "text"), "double", 1),
    ("metricLength", "ST_Length({0})", _ONE, "double", 0),
    ("perimeter", "ST_Perimeter({0})", (*_ONE, "text"), "double", 1),
    ("metricPerimeter", "ST_Perimeter({0})", _ONE, "double", 0),
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
    ("getSRID", "''::text", _ONE, "string", 0),
    ("relate", "ST_Relate({0}, {1}, {2})", (*_TWO, "text"), "boolean", 0),
    ("asWKT", "{0}", _ONE, "geometry", 0),
    ("asGML", "ST_AsGML(3, {0})", (*_ONE, "text"), "gml", 1),
    ("asGeoJSON", "ST_AsGeoJSON({0})", _ONE, "geojson", 0),
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

AGGREGATES: Mapping[str, str] = {
    "aggBoundingBox": "ST_Envelope(ST_Collect({0}))",
    "aggBoundingCircle": "ST_MinimumBoundingCircle(ST_Collect({0}))",
    "aggCentroid": "ST_Centroid(ST_Collect({0}))",
    "aggConcaveHull": "ST_ConcaveHull(ST_Collect({0}), 0.8)",
    "aggConvexHull": "ST_ConvexHull(ST_Collect({0}))",
    "aggUnion": "ST_Union({0})",
}
"""The functions of `geof:` that make one geometry of those of a group."""

_TURNED = str.maketrans("<>", "><")
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
    tree: CompValue, value: Callable[[Any], Value], number: Callable[[Value], str]
) -> str | None:
    """Return a condition that the spatial index answers, for `geof:distance(a, b) < d`."""
    near, far = (tree.expr, tree.other) if tree.op in ("<", "<=") else (tree.other, tree.expr)
    if getattr(near, "name", "") != "Function" or str(near.iri) not in _DISTANCES:
        return None
    a, b = (geometry_of(value(each)) for each in near.expr[:2])
    return f"ST_DWithin({a}, {b}, {number(value(far))})"
