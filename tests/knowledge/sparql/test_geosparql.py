"""Relations and functions of GeoSPARQL are those of Shapely on the same footprints."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import TypeAlias

import numpy as np
import psycopg
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.knowledge.mapping import DATATYPES, TOPOLOGICAL
from semmap.knowledge.queries import query
from semmap.knowledge.sparql.geosparql import FUNCTIONS, literal_geometry
from semmap.knowledge.sparql.values import Parameters

Shape: TypeAlias = shapely.Geometry

RELATIONS: dict[str, Callable[[Shape, Shape], bool]] = {
    "sfEquals": lambda a, b: a.equals(b),
    "sfDisjoint": lambda a, b: a.disjoint(b),
    "sfIntersects": lambda a, b: a.intersects(b),
    "sfTouches": lambda a, b: a.touches(b),
    "sfCrosses": lambda a, b: a.crosses(b),
    "sfWithin": lambda a, b: a.within(b),
    "sfContains": lambda a, b: a.contains(b),
    "sfOverlaps": lambda a, b: a.overlaps(b),
    "ehEquals": lambda a, b: a.equals(b),
    "ehDisjoint": lambda a, b: a.disjoint(b),
    "ehMeet": lambda a, b: a.touches(b),
    "ehOverlap": lambda a, b: a.relate_pattern(b, "T*T***T**"),
    "ehCovers": lambda a, b: a.relate_pattern(b, "T*TFT*FF*"),
    "ehCoveredBy": lambda a, b: a.relate_pattern(b, "TFF*TFT**"),
    "ehInside": lambda a, b: a.relate_pattern(b, "TFF*FFT**"),
    "ehContains": lambda a, b: a.relate_pattern(b, "T*TFF*FF*"),
    "rcc8eq": lambda a, b: a.equals(b),
    "rcc8dc": lambda a, b: a.disjoint(b),
    "rcc8ec": lambda a, b: a.touches(b),
    "rcc8po": lambda a, b: a.overlaps(b),
    "rcc8tppi": lambda a, b: a.contains(b) and not a.equals(b) and not a.contains_properly(b),
    "rcc8tpp": lambda a, b: b.contains(a) and not a.equals(b) and not b.contains_properly(a),
    "rcc8ntpp": lambda a, b: b.contains_properly(a),
    "rcc8ntppi": lambda a, b: a.contains_properly(b),
}
"""Each relation, of polygons."""

SQUARES = st.builds(
    lambda x, y, w, h: shapely.box(x, y, x + w, y + h),
    *[st.integers(0, 3)] * 2,
    *[st.integers(1, 3)] * 2,
)


def wkt(shape: Shape) -> str:
    return f'"{shape.wkt}"^^geo:wktLiteral'


def test_each_relation_has_an_oracle() -> None:
    assert RELATIONS.keys() == TOPOLOGICAL.keys()


@settings(max_examples=5)
@given(pairs=st.lists(st.tuples(SQUARES, SQUARES), min_size=20, max_size=20))
def test_topological_functions(loft: psycopg.Connection, pairs: list[tuple[Shape, Shape]]) -> None:
    rows = " ".join(f"({i} {wkt(a)} {wkt(b)})" for i, (a, b) in enumerate(pairs))
    calls = " ".join(f"(geof:{name}(?a, ?b) AS ?{name})" for name in RELATIONS)
    answer = query(loft, f"SELECT ?i {calls} {{ VALUES (?i ?a ?b) {{ {rows} }} }} ORDER BY ?i")
    found = [[term.toPython() for term in row[1:]] for row in answer.rows]
    assert found == [[holds(a, b) for holds in RELATIONS.values()] for a, b in pairs]


@pytest.fixture(scope="module")
def footprints(loft: psycopg.Connection) -> dict[str, Shape]:
    answer = query(loft, "SELECT ?x ?w { ?x geo:hasDefaultGeometry/geo:asWKT ?w ; semmap:name ?n }")
    found = {str(x): shapely.from_wkt(str(w)) for x, w in answer.rows}
    assert len(found) >= 8
    return found


@pytest.mark.parametrize("name", ["sfContains", "sfWithin", "sfDisjoint", "ehMeet", "rcc8ntpp"])
def test_relations_of_features_are_rewritten(
    loft: psycopg.Connection, footprints: dict[str, Shape], name: str
) -> None:
    expected = {
        (a, b)
        for a, b in product(footprints, repeat=2)
        if RELATIONS[name](footprints[a], footprints[b])
    }
    for text in (
        f"SELECT ?a ?b {{ ?a geo:{name} ?b . ?a semmap:name ?n . ?b semmap:name ?m }}",
        f"SELECT ?a ?b {{ ?a geo:hasDefaultGeometry ?g . ?b geo:hasDefaultGeometry ?h . "
        f"?g geo:{name} ?h }}",
    ):
        assert {(str(a), str(b)) for a, b in query(loft, text).rows} == expected


def test_functions_of_geometry(loft: psycopg.Connection) -> None:
    a, b = shapely.box(0, 0, 2, 1), shapely.box(1, 0, 3, 1)
    row = query(
        loft,
        "SELECT (geof:distance(?a, ?c, uom:metre) AS ?d) (geof:area(?a, uom:metre) AS ?e) "
        "(geof:intersection(?a, ?b) AS ?f) (geof:union(?a, ?b) AS ?g) (geof:convexHull(?a) AS ?h) "
        "(geof:buffer(?c, 1, uom:metre) AS ?i) (geof:maxX(?b) AS ?j) (geof:is3D(?c) AS ?k) "
        "(geof:asGML(?c) AS ?l) (geof:asGeoJSON(?c) AS ?m) (semmap:distance3D(?c, ?z) AS ?n) "
        f"{{ BIND({wkt(a)} AS ?a) BIND({wkt(b)} AS ?b) "
        'BIND("POINT Z (5 0 0)"^^geo:wktLiteral AS ?c) '
        'BIND("POINT Z (5 3 4)"^^geo:wktLiteral AS ?z) }',
    ).rows[0]
    distance, area, common, both, hull, around, reach, solid, gml, json, far = row
    assert distance.toPython() == pytest.approx(3)
    assert area.toPython() == pytest.approx(2)
    assert shapely.from_wkt(str(common)).equals(a.intersection(b))
    assert shapely.from_wkt(str(both)).equals(a.union(b))
    assert shapely.from_wkt(str(hull)).equals(a)
    assert shapely.from_wkt(str(around)).area == pytest.approx(3.14, abs=0.05)
    assert (reach.toPython(), solid.toPython(), far.toPython()) == (3.0, True, 5.0)
    assert "gml:Point" in str(gml)
    assert '"Point"' in str(json)


def test_literals_in_gml_and_geojson(loft: psycopg.Connection) -> None:
    gml = "<gml:Point xmlns:gml='http://www.opengis.net/gml'><gml:pos>2.7 1.7</gml:pos></gml:Point>"
    json = "{'type': 'Point', 'coordinates': [2.7, 1.7]}".replace("'", '\\"')
    for literal in (
        f'"{gml}"^^geo:gmlLiteral',
        f'"{json}"^^geo:geoJSONLiteral',
        '"<http://www.opengis.net/def/crs/EPSG/0/0> POINT(2.7 1.7)"^^geo:wktLiteral',
    ):
        text = (
            f"SELECT ?x {{ ?x geo:hasDefaultGeometry/geo:asWKT ?w ; a semmap:Object "
            f"FILTER(geof:sfContains(?w, {literal})) }}"
        )
        assert [str(x).rsplit("#")[-1] for (x,) in query(loft, text).rows] == ["table"], literal
    wrong = 'ASK { FILTER(geof:sfContains("POINT(0 0)"^^geo:wktLiteral, "no"^^geo:wktLiteral)) }'
    assert query(loft, wrong).truth is False


def test_relations_of_surfaces_are_those_of_the_sql_functions(loft: psycopg.Connection) -> None:
    for name, function in (("on", "is_on"), ("in", "is_in"), ("near", "is_near")):
        extra = ", 1" if name == "near" else ""
        expected = loft.execute(
            f"SELECT a.name, b.name FROM entity a, entity b WHERE a.map_id = current_map() "
            f"AND b.map_id = current_map() AND a.kind = 'object' AND b.kind = 'object' "
            f"AND a.id <> b.id AND {function}(a.id, b.id{extra})"
        ).fetchall()
        answer = query(
            loft,
            f"SELECT ?m ?n {{ ?a semmap:{name} ?b . ?a semmap:kind 'object' ; semmap:name ?m . "
            "?b semmap:kind 'object' ; semmap:name ?n }",
        )
        assert sorted((str(m), str(n)) for m, n in answer.rows) == sorted(expected), name
    assert query(loft, "ASK { :cup%201 semmap:on :table }").truth
    assert query(loft, "SELECT ?x { ?x semmap:on :table }").rows
    assert query(loft, "SELECT ?x { :cup%201 semmap:on ?x }").rows


def test_a_distance_is_compared_by_the_spatial_index(loft: psycopg.Connection) -> None:
    answer = query(
        loft,
        "SELECT ?x { ?x geo:hasDefaultGeometry/geo:asWKT ?w FILTER(geof:distance(?w, "
        '"POINT(7.5 3.5)"^^geo:wktLiteral, uom:metre) < 0.1) }',
    )
    assert "ST_Expand" in answer.explanation[0]
    assert {str(x).rsplit("#")[-1] for (x,) in answer.rows} == {"stove", "cooking%20corner"}


def test_sizes_of_objects_are_those_of_shapely(
    loft: psycopg.Connection, footprints: dict[str, Shape]
) -> None:
    """The narrowest direction is looked for among 3,600, not along the sides of the hull."""
    sizes = (
        "semmap:boxWidth ?w ; semmap:boxLength ?l ; semmap:boxHeight ?h ; semmap:graspWidth ?g ; "
        "semmap:lowest ?low ; semmap:highest ?high"
    )
    rows = query(loft, f"SELECT ?x ?w ?l ?h ?g ?low ?high {{ ?x {sizes} }}").rows
    kinds = query(loft, "SELECT ?x { ?x semmap:kind 'object' ; geo:hasDefaultGeometry ?g }").rows
    assert {row[0] for row in rows} == {row[0] for row in kinds}
    assert len(rows) > 3
    turns = np.pi * np.arange(3600) / 3600
    for x, width, length, height, grasp, low, high in rows:
        area = footprints[str(x)]
        corners = shapely.get_coordinates(area.minimum_rotated_rectangle)
        sides = np.linalg.norm(np.diff(corners[:3], axis=0), axis=1)
        assert [float(width), float(length)] == pytest.approx(sorted(sides), abs=1e-6)
        assert float(height) == pytest.approx(float(high) - float(low))
        points = shapely.get_coordinates(area.convex_hull)
        across = np.ptp(points @ np.array([np.cos(turns), np.sin(turns)]), axis=0).min()
        assert across - 0.001 * float(length) <= float(grasp) <= across + 1e-9


@settings(max_examples=60, deadline=None)
@given(points=st.lists(st.tuples(*2 * [st.integers(-9, 9)]), min_size=1, max_size=9))
def test_the_least_width_is_that_of_all_directions(
    loft: psycopg.Connection, points: list[tuple[int, int]]
) -> None:
    shape = shapely.MultiPoint(points)
    found = loft.execute("SELECT least_width(ST_GeomFromText(%s))", [shape.wkt]).fetchone()
    turns = np.pi * np.arange(3600) / 3600
    spread = np.array(points) @ np.array([np.cos(turns), np.sin(turns)])
    across = np.ptp(spread, axis=0).min()
    assert found is not None
    assert across - 0.03 <= found[0] <= across + 1e-9


CRS = "http://www.opengis.net/def/crs/"
ARGUMENTS = {
    "geometry": (wkt(shapely.box(0, 0, 2, 1)), wkt(shapely.box(1, 0, 3, 1))),
    "entity": (":table", ":sofa"),
    "number": ("1", "1"),
    "text": ("", f"<{CRS}EPSG/0/25832>", '"T********"'),
    "literal": ("",),
    "length": 3 * ("uom:metre",),
    "area": 2 * ("uom:metre",),
    "time": ("NOW()", "NOW()"),
    "voxel": ("<urn:semmap:voxel:0.05:1,2,3>",),
}


@pytest.mark.parametrize("iri", FUNCTIONS)
def test_functions_have_their_values_where_rdflib_evaluates(
    loft: psycopg.Connection, iri: str
) -> None:
    kinds = FUNCTIONS[iri].arguments
    given = [ARGUMENTS[kind][min(i, len(ARGUMENTS[kind]) - 1)] for i, kind in enumerate(kinds)]
    if iri.endswith(("transform", "getSRID")):  # not of the map's frame
        given[0] = f'"<{CRS}EPSG/0/4326> POINT(52 8)"^^geo:wktLiteral'
    call = f"(<{iri}>({', '.join(given)}) AS ?value)"
    ((value,),) = query(loft, f"SELECT {call} {{}}").rows
    answer = query(loft, f"SELECT {call} (TZ(NOW()) AS ?zone) {{}}")
    assert answer.explanation[0].startswith("evaluated by rdflib")
    assert value is not None
    assert answer.rows[0][0] == value


def test_a_function_that_is_unknown_is_named(loft: psycopg.Connection) -> None:
    answer = query(loft, f"SELECT (geof:asKML({wkt(shapely.Point(0, 0))}) AS ?x) {{}}")
    assert answer.rows == ((None,),)
    assert "there is no function geof:asKML" in answer.notes[0]
    assert query(loft, "SELECT (xsd:integer('1') AS ?x) {}").notes == ()


@pytest.mark.parametrize(
    "text",
    [
        "POINT(1 2)",
        " point ( 1.5 -2e3 )",
        "POINT(1 2 3)",
        "POINT(1 2 3 4)",
        "POINT Z (1 2 3)",
        "POINT M (1 2 3)",
        "POINT EMPTY",
        "POINT(1e400 0)",
        "POINT(1)",
        "POINT(1 2) x",
        "POINT(1 2",
        "MULTIPOINT(0 0, 1 1)",
        "MULTIPOINT((0 0), (1 1))",
        "LINESTRING(0 0)",
        "LINESTRING(0 0, 1 1, 0 0)",
        "LINESTRING(0 0, 1 1 1)",
        "POLYGON((0 0, 1 0, 1 1, 0 0))",
        "POLYGON((0 0, 1 0, 1 1))",
        "POLYGON((0 0, 1 1, 0 0))",
        "POLYGON((0 0, 4 0, 4 4, 0 0), (2 1, 3 1, 3 2, 2 1))",
        "MULTIPOLYGON(((0 0, 1 0, 1 1, 0 0)))",
        "MULTILINESTRING((0 0, 1 0), (2 2, 3 3))",
        "GEOMETRYCOLLECTION(POINT(1 2))",
        "CIRCULARSTRING(0 0, 1 1, 2 0)",
        "TIN(((0 0 0, 1 0 0, 0 1 0, 0 0 0)))",
        "<http://www.opengis.net/def/crs/EPSG/0/4326> POINT(52 8)",
        "",
        "no",
    ],
)
def test_a_literal_of_a_query_is_read_as_a_stored_one(loft: psycopg.Connection, text: str) -> None:
    tag = DATATYPES["geometry"]
    values = Parameters()
    sql = literal_geometry(text, tag, values.bind)
    as_text = "SELECT ST_AsEWKT({})".format
    found = loft.execute(as_text(sql).encode(), values.values).fetchone()
    stored = as_text("text_geometry(%s::text, %s::text)").encode()
    assert found == loft.execute(stored, [text, tag]).fetchone()
