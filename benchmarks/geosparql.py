"""The requirements of GeoSPARQL 1.1 (OGC 22-047r1), each with checks on a small map.

A check is a query of ASK whose answer has to be yes, or two queries with the same answer.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Any

import psycopg

from semmap import Database
from semmap.knowledge.mapping import TOPOLOGICAL
from semmap.knowledge.queries import query

__all__ = ["CLASSES", "REQUIREMENTS", "Requirement", "classes", "failed", "small_map"]

SHAPE = "geo:hasDefaultGeometry/geo:asWKT"
POINT = '"POINT(1 2)"^^geo:wktLiteral'
SQUARE = '"POLYGON((0 0, 2 0, 2 2, 0 2, 0 0))"^^geo:wktLiteral'
GML = (
    "\"<gml:Point xmlns:gml='http://www.opengis.net/gml'><gml:pos>1 2</gml:pos></gml:Point>\""
    "^^geo:gmlLiteral"
)
GEOJSON = '\'{"type": "Point", "coordinates": [1, 2]}\'^^geo:geoJSONLiteral'
NO_COLLECTIONS = "a map has no collections; statements may use the class"
CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
EAST_FIRST = f'"<{CRS84}> POINT(8 52)"^^geo:wktLiteral'
NORTH_FIRST = '"<http://www.opengis.net/def/crs/EPSG/0/4326> POINT(52 8)"^^geo:wktLiteral'


@dataclass(frozen=True)
class Requirement:
    """A requirement.

    Attributes
    ----------
    name : as in the specification, after .../spec/geosparql/1.1/req/
    checks : queries of ASK
    same : pairs of queries that have the same rows
    missing : why it is not met; empty where it is
    """

    name: str
    checks: tuple[str, ...] = ()
    same: tuple[tuple[str, str], ...] = ()
    missing: str = ""


def ask(*conditions: str) -> tuple[str, ...]:
    """Return a check for each condition."""
    return tuple(f"ASK {{ FILTER({condition}) }}" for condition in conditions)


def group(expression: str, condition: str) -> str:
    """Return a check of an aggregate of the outlines of two tables."""
    return (
        f"ASK {{ {{ SELECT ({expression} AS ?u) {{ ?x a semmap:Table ; {SHAPE} ?w }} }} "
        f"FILTER({condition}) }}"
    )


EXAMPLES = {
    **dict.fromkeys(("sfEquals", "ehEquals", "rcc8eq"), ("table", "table")),
    **dict.fromkeys(("sfDisjoint", "ehDisjoint", "rcc8dc"), ("table", "desk")),
    **dict.fromkeys(("sfTouches", "ehMeet", "rcc8ec"), ("table", "bench")),
    **dict.fromkeys(("sfOverlaps", "ehOverlap", "rcc8po"), ("table", "rug")),
    **dict.fromkeys(("sfContains", "ehContains", "rcc8ntppi"), ("studio", "cup")),
    **dict.fromkeys(("sfWithin", "ehInside", "rcc8ntpp"), ("cup", "studio")),
    **dict.fromkeys(("ehCovers", "rcc8tppi"), ("table", "tray")),
    **dict.fromkeys(("ehCoveredBy", "rcc8tpp"), ("tray", "table")),
    "sfIntersects": ("studio", "table"),
}
"""Two entities of the small map that have a relation; two areas never cross."""


def functions(family: str) -> tuple[str, ...]:
    """Return checks that each function of a family tells a square from another."""
    return tuple(
        f"ASK {{ BIND(geof:{name}({SQUARE}, {SQUARE}) AS ?same) "
        f'BIND(geof:{name}({SQUARE}, "POINT(9 9)"^^geo:wktLiteral) AS ?far) '
        "FILTER(isLITERAL(?same) && isLITERAL(?far)) "
        f"FILTER(?far = {'true' if name in _FAR else 'false'}) }}"
        for name in TOPOLOGICAL
        if name.startswith(family)
    )


_FAR = ("sfDisjoint", "ehDisjoint")
"""The relations of a square and a point outside of it: rcc8 relates regions only."""


def rewrites(family: str) -> tuple[tuple[str, str], ...]:
    """Return, for each relation of a family, what it means between features and geometries."""
    pairs = []
    for name in (name for name in TOPOLOGICAL if name.startswith(family)):
        of = "?a semmap:kind ?k . ?b semmap:kind ?l ."
        meant = f"SELECT ?a ?b {{ {of} ?a {SHAPE} ?v . ?b {SHAPE} ?w FILTER(geof:{name}(?v, ?w)) }}"
        joins = "?a geo:hasDefaultGeometry ?g . ?b geo:hasDefaultGeometry ?h ."
        for triple in (
            f"?a geo:{name} ?b",
            f"{joins} ?a geo:{name} ?h",
            f"{joins} ?g geo:{name} ?b",
            f"{joins} ?g geo:{name} ?h",
        ):
            pairs.append((f"SELECT ?a ?b {{ {of} {triple} }}", meant))
    return tuple(pairs)


REQUIREMENTS = (
    Requirement("core/sparql-protocol", ("ASK {}",)),
    Requirement("core/spatial-object-class", ("ASK { :cup a geo:SpatialObject }",)),
    Requirement("core/feature-class", ("ASK { :cup a geo:Feature . :studio a geo:Feature }",)),
    Requirement(
        "core/spatial-object-collection-class",
        missing=NO_COLLECTIONS,
    ),
    Requirement("core/feature-collection-class", missing=NO_COLLECTIONS),
    Requirement(
        "core/spatial-object-properties",
        (
            "ASK { :table geo:hasMetricArea ?a FILTER(ABS(?a - 2) < 0.001) }",
            "ASK { :table geo:hasMetricPerimeterLength ?p FILTER(ABS(?p - 6) < 0.001) }",
        ),
    ),
    Requirement(
        "geometry-extension/geometry-class",
        ("ASK { :table geo:hasDefaultGeometry ?g . ?g a geo:Geometry, geo:SpatialObject }",),
    ),
    Requirement("geometry-extension/geometry-collection-class", missing=NO_COLLECTIONS),
    Requirement(
        "geometry-extension/feature-properties",
        tuple(
            f"ASK {{ :table geo:{name}/geo:asWKT ?w }}"
            for name in ("hasGeometry", "hasDefaultGeometry", "hasBoundingBox", "hasCentroid")
        ),
    ),
    Requirement(
        "geometry-extension/geometry-properties",
        tuple(
            f"ASK {{ :table geo:hasDefaultGeometry/geo:{name} {value} }}"
            for name, value in (
                ("dimension", "2"),
                ("coordinateDimension", "2"),
                ("spatialDimension", "2"),
                ("isEmpty", "false"),
                ("isSimple", "true"),
                ("hasSerialization", "?w"),
            )
        ),
    ),
    Requirement(
        "geometry-extension/query-functions",
        ask(
            f"geof:distance({POINT}, {SQUARE}, uom:metre) = 0",
            f"geof:metricDistance({POINT}, {SQUARE}) = 0",
            f"geof:area(geof:buffer({POINT}, 1, uom:metre)) > 3",
            f"geof:area(geof:metricBuffer({POINT}, 1)) > 3",
            f"geof:sfEquals(geof:intersection({POINT}, {SQUARE}), {POINT})",
            f"geof:sfEquals(geof:union({POINT}, {SQUARE}), {SQUARE})",
            f"geof:isEmpty(geof:difference({POINT}, {SQUARE}))",
            f"geof:isEmpty(geof:symDifference({SQUARE}, {SQUARE}))",
            f"geof:sfEquals(geof:convexHull({SQUARE}), {SQUARE})",
            f"geof:sfEquals(geof:envelope({SQUARE}), {SQUARE})",
            f"geof:metricLength(geof:boundary({SQUARE})) = 8",
        ),
    ),
    Requirement(
        "geometry-extension/query-functions-non-sf",
        ask(
            f"geof:metricArea({SQUARE}) = 4 && geof:area({SQUARE}, uom:squareMetre) = 4",
            f"geof:metricPerimeter({SQUARE}) = 8 && geof:perimeter({SQUARE}, uom:metre) = 8",
            f"geof:length(geof:boundary({SQUARE}), uom:metre) = 8",
            f"geof:area(geof:boundingCircle({SQUARE})) > 6",
            f"geof:sfEquals(geof:concaveHull({SQUARE}), {SQUARE})",
            f"geof:sfEquals(geof:centroid({SQUARE}), 'POINT(1 1)'^^geo:wktLiteral)",
            f"geof:dimension({SQUARE}) = 2 && geof:coordinateDimension({SQUARE}) = 2",
            f"geof:spatialDimension({SQUARE}) = 2 && !geof:is3D({SQUARE})",
            f"!geof:isMeasured({SQUARE}) && geof:isSimple({SQUARE}) && !geof:isEmpty({SQUARE})",
            f"geof:geometryType({SQUARE}) = sf:Polygon",
            "geof:numGeometries('MULTIPOINT((1 1), (2 2))'^^geo:wktLiteral) = 2",
            "geof:sfEquals(geof:geometryN('MULTIPOINT((1 1), (2 2))'^^geo:wktLiteral, 2), "
            "'POINT(2 2)'^^geo:wktLiteral)",
            f"geof:minX({SQUARE}) = 0 && geof:maxX({SQUARE}) = 2 && geof:minY({POINT}) = 2",
            "geof:maxY('POINT Z (1 2 3)'^^geo:wktLiteral) = 2 "
            "&& geof:minZ('POINT Z (1 2 3)'^^geo:wktLiteral) = 3 "
            "&& geof:maxZ('POINT Z (1 2 3)'^^geo:wktLiteral) = 3",
        ),
    ),
    Requirement(
        "geometry-extension/transform",
        ask(
            f"geof:sfEquals(geof:transform({NORTH_FIRST}, <{CRS84}>), {EAST_FIRST})",
            f"geof:getSRID(geof:transform({NORTH_FIRST}, <{CRS84}>)) = '{CRS84}'",
        ),
    ),
    Requirement(
        "geometry-extension/srid-function",
        ask(f"geof:getSRID({POINT}) = ''", f"geof:getSRID({EAST_FIRST}) = '{CRS84}'"),
    ),
    Requirement(
        "geometry-extension/sa-functions",
        (
            group("geof:aggUnion(?w)", "ABS(geof:metricArea(?u) - 4) < 0.001"),
            group("geof:aggBoundingBox(?w)", "ABS(geof:metricArea(?u) - 5) < 0.001"),
            group("geof:aggConvexHull(?w)", "ABS(geof:metricArea(?u) - 5) < 0.001"),
            group("geof:aggConcaveHull(?w)", "geof:metricArea(?u) > 3.9"),
            group("geof:aggBoundingCircle(?w)", "geof:metricArea(?u) > 5"),
            group("geof:aggCentroid(?w)", "ABS(geof:minX(?u) - 2.5) < 0.001"),
        ),
    ),
    Requirement("geometry-extension/wkt-literal", ask(f"geof:dimension({POINT}) = 0")),
    Requirement(
        "geometry-extension/wkt-literal-default-srs",
        ask(f"geof:distance({POINT}, 'POINT(4 6)'^^geo:wktLiteral, uom:metre) = 5"),
    ),
    Requirement(
        "geometry-extension/wkt-axis-order",
        ask(f"geof:minX({POINT}) = 1", f"geof:minX({NORTH_FIRST}) = 8"),
    ),
    Requirement("geometry-extension/wkt-literal-empty", ask("geof:isEmpty(''^^geo:wktLiteral)")),
    Requirement(
        "geometry-extension/geometry-as-wkt-literal",
        (f"ASK {{ :table {SHAPE} ?w FILTER(DATATYPE(?w) = geo:wktLiteral) }}",),
    ),
    Requirement("geometry-extension/asWKT-function", ask(f"STR(geof:asWKT({GML})) = 'POINT(1 2)'")),
    Requirement("geometry-extension/gml-literal", ask(f"geof:sfEquals({GML}, {POINT})")),
    Requirement("geometry-extension/gml-literal-empty", ask("geof:isEmpty(''^^geo:gmlLiteral)")),
    Requirement("geometry-extension/gml-profile", ask(f"geof:sfTouches({GML}, {SQUARE})")),
    Requirement(
        "geometry-extension/geometry-as-gml-literal",
        ("ASK { :table geo:hasGeometry/geo:asGML ?g FILTER(geof:dimension(?g) = 2) }",),
    ),
    Requirement(
        "geometry-extension/asGML-function",
        ask(
            f"DATATYPE(geof:asGML({POINT}, 'http://www.opengis.net/gml/3.2')) = geo:gmlLiteral",
            f"geof:sfEquals(geof:asGML({SQUARE}), {SQUARE})",
        ),
    ),
    Requirement("geometry-extension/geojson-literal", ask(f"geof:sfEquals({GEOJSON}, {POINT})")),
    Requirement("geometry-extension/geojson-literal-srs", ask(f"geof:maxY({GEOJSON}) = 2")),
    Requirement(
        "geometry-extension/geojson-literal-empty", ask("geof:isEmpty(''^^geo:geoJSONLiteral)")
    ),
    Requirement(
        "geometry-extension/geometry-as-geojson-literal",
        ("ASK { :table geo:hasGeometry/geo:asGeoJSON ?g FILTER(geof:dimension(?g) = 2) }",),
    ),
    Requirement(
        "geometry-extension/asGeoJSON-function",
        ask(f"geof:sfEquals(geof:asGeoJSON({SQUARE}), {SQUARE})"),
    ),
    *(
        Requirement(
            f"geometry-extension/{name}", missing=f"{format_.upper()} is neither read nor written"
        )
        for format_ in ("kml", "dggs")
        for name in (
            f"{format_}-literal",
            f"{format_}-literal-empty",
            f"geometry-as-{format_}-literal",
            f"as{format_.upper()}-function",
        )
    ),
    *(
        Requirement(
            f"topology-vocab-extension/{family}-spatial-relations",
            tuple(
                f"ASK {{ :{a} geo:{name} :{b} . :{a} geo:hasDefaultGeometry/geo:{name} :{b} }}"
                for name, (a, b) in EXAMPLES.items()
                if name.startswith(family)
            ),
        )
        for family in ("sf", "eh", "rcc8")
    ),
    Requirement(
        "geometry-topology-extension/relate-query-function",
        ask(f"geof:relate({POINT}, {SQUARE}, 'F0FFFF212')"),
    ),
    *(
        Requirement(f"geometry-topology-extension/{family}-query-functions", functions(family))
        for family in ("sf", "eh", "rcc8")
    ),
    Requirement(
        "rdfs-entailment-extension/bgp-rdfs-ent",
        ("ASK { :table a semmap:Furniture . semmap:Table rdfs:subClassOf* semmap:Furniture }",),
    ),
    Requirement(
        "rdfs-entailment-extension/wkt-geometry-types",
        ("ASK { :table geo:hasDefaultGeometry ?g . ?g a sf:MultiPolygon }",),
    ),
    Requirement(
        "rdfs-entailment-extension/gml-geometry-types",
        missing="geometries have the classes of Simple Features",
    ),
    *(
        Requirement(f"query-rewrite-extension/{family}-query-rewrite", same=rewrites(family))
        for family in ("sf", "eh", "rcc8")
    ),
)
"""All requirements, in the order of the specification."""


def small_map(database: Database) -> psycopg.Connection[Any]:
    """Make a map with an example of each relation of outlines; return a session that sees it."""
    made = database.create_map("small")
    made.add_room("studio", [(0, 0), (6, 0), (6, 5), (0, 5)], floor=0, ceiling=3)
    made.add_object("table", type="table", size=(2, 1, 0.75), pose=(1, 1, 0))
    made.add_object("desk", type="table", size=(2, 1, 0.75), pose=(4, 1, 0))
    made.add_object("bench", type="bench", size=(1, 1, 0.4), pose=(2.5, 1, 0))
    made.add_object("rug", type="carpet", size=(2, 1, 0.01), pose=(1, 1.5, 0))
    made.add_object("tray", type="tray", size=(1, 1, 0.02), pose=(0.5, 1, 0.75))
    made.add_object("cup", type="cup", size=(0.08, 0.08, 0.1), on="table")
    return made.connection


def failed(session: psycopg.Connection[Any], requirement: Requirement) -> list[str]:
    """Return the checks of a requirement that fail."""
    wrong = [text for text in requirement.checks if not query(session, text).truth]
    for text, other in requirement.same:
        if set(query(session, text).rows) != set(query(session, other).rows):
            wrong.append(text)
    return wrong


CLASSES = ("conformance class", "requirements", "met", "checks", "not met")
"""The columns of `classes`."""


def classes(session: psycopg.Connection[Any]) -> list[list[Any]]:
    """Return a row for each conformance class."""
    rows = []
    for name, group in groupby(REQUIREMENTS, lambda each: each.name.partition("/")[0]):
        of_class = list(group)
        unmet: dict[str, list[str]] = {}
        for each in of_class:
            if reason := "; ".join(failed(session, each)) or each.missing:
                unmet.setdefault(reason, []).append(each.name.partition("/")[2])
        missing = sum(map(len, unmet.values()))
        checks = sum(len(each.checks) + len(each.same) for each in of_class)
        why = "; ".join(f"{', '.join(names)}: {reason}" for reason, names in unmet.items())
        rows.append([name, len(of_class), len(of_class) - missing, checks, why or "-"])
    return rows
