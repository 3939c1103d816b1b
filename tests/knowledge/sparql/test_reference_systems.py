"""Literals in reference systems, beside pyproj."""

from __future__ import annotations

from typing import Any

import psycopg
import pyproj
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.knowledge.queries import query
from semmap.knowledge.updates import update
from semmap.language.error import QueryError

CRS = "http://www.opengis.net/def/crs/"
CRS84, WGS84, UTM = f"{CRS}OGC/1.3/CRS84", f"{CRS}EPSG/0/4326", f"{CRS}EPSG/0/25832"
UNIT = "http://qudt.org/vocab/unit/"
EARTH = pyproj.Geod(ellps="WGS84")

longitudes, latitudes = st.floats(-179, 179), st.floats(-85, 85)
places = st.tuples(longitudes, latitudes)


GML = (
    "\"<gml:Point xmlns:gml='http://www.opengis.net/gml/3.2' srsName='%s'>"
    '<gml:pos>8 52</gml:pos></gml:Point>"^^geo:gmlLiteral'
)
JSON = (
    '"""{"type": "Point", "coordinates": [8, 52], '
    '"crs": {"type": "name", "properties": {"name": "%s"}}}"""^^geo:geoJSONLiteral'
)


def wkt(shape: str, system: str = "") -> str:
    return f'"<{system}> {shape}"^^geo:wktLiteral' if system else f'"{shape}"^^geo:wktLiteral'


def value(session: psycopg.Connection, expression: str) -> Any:
    ((found,),) = query(session, f"SELECT ({expression} AS ?x) {{}}").rows
    return None if found is None else found.toPython()  # type: ignore[attr-defined]


@settings(max_examples=40, deadline=None)
@given(a=places, b=places)
def test_distances_are_geodesics(
    loft: psycopg.Connection, a: tuple[float, float], b: tuple[float, float]
) -> None:
    expected = EARTH.inv(*a, *b)[2]
    first = wkt(f"POINT({a[0]} {a[1]})", CRS84)
    second = wkt(f"POINT({b[1]} {b[0]})", WGS84)
    assert value(loft, f"geof:distance({first}, {second}, uom:metre)") == pytest.approx(
        expected, rel=1e-6, abs=1e-3
    )
    assert value(loft, f"geof:metricDistance({second}, {first})") == pytest.approx(
        expected, rel=1e-6, abs=1e-3
    )
    flat = shapely.Point(a).distance(shapely.Point(b))
    assert value(loft, f"geof:distance({second}, {first}, uom:degree)") == pytest.approx(flat)


@settings(max_examples=25, deadline=None)
@given(at=st.tuples(st.floats(6, 12), st.floats(47, 55)), size=st.floats(0.001, 0.5))
def test_sizes_and_transformations(
    loft: psycopg.Connection, at: tuple[float, float], size: float
) -> None:
    box = shapely.box(*at, at[0] + size, at[1] + size)
    area, around = EARTH.geometry_area_perimeter(shapely.geometry.polygon.orient(box))
    literal = wkt(box.wkt, CRS84)
    assert value(loft, f"geof:area({literal}, <{UNIT}HA>)") == pytest.approx(area / 1e4, rel=1e-6)
    assert value(loft, f"geof:metricArea({literal})") == pytest.approx(area, rel=1e-6)
    assert value(loft, f"geof:perimeter({literal}, uom:metre)") == pytest.approx(around, rel=1e-6)
    to_utm = pyproj.Transformer.from_crs(4326, 25832, always_xy=True)
    moved = value(loft, f"geof:transform({wkt(f'POINT({at[1]} {at[0]})', WGS84)}, <{UTM}>)")
    assert str(moved).startswith(f"<{UTM}> ")
    found = shapely.from_wkt(str(moved).partition("> ")[2])
    assert (found.x, found.y) == pytest.approx(to_utm.transform(*at), abs=1e-3)
    back = f"geof:transform({wkt(found.wkt, UTM)}, <{WGS84}>)"
    metres = value(
        loft, f"geof:distance({back}, {wkt(f'POINT({at[0]} {at[1]})', CRS84)}, uom:metre)"
    )
    assert metres < 1e-3


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (f"geof:getSRID({wkt('POINT(52 8)', WGS84)})", WGS84),
        (f"geof:getSRID({wkt('POINT(8 52)', CRS84)})", CRS84),
        (f"geof:getSRID({wkt('POINT(8 52)')})", ""),
        (f"geof:sfEquals({wkt('POINT(52 8)', WGS84)}, {wkt('POINT(8 52)', CRS84)})", True),
        (f"geof:sfEquals({wkt('POINT(8 52)', WGS84)}, {wkt('POINT(8 52)', CRS84)})", False),
        (f"geof:minX({wkt('POINT(52 8)', 'urn:ogc:def:crs:EPSG::4326')})", 8.0),
        (f"geof:distance({wkt('POINT(0 0)', UTM)}, {wkt('POINT(3 4)', UTM)}, uom:metre)", 5.0),
        (f"geof:distance({wkt('POINT(0 0)')}, {wkt('POINT(3 4)')}, <{UNIT}KiloM>)", 0.005),
        # longitude first, as its name says
        (f"geof:minX({wkt('POINT(8 52)', f'{CRS}EPSG/0/7084')})", 8.0),
        # no place in the other system, no such line on the ellipsoid
        (f"geof:transform({wkt('POINT(95 8)', WGS84)}, <{UTM}>)", None),
        (f"geof:asGeoJSON({wkt('POINT(1e30 1e30)', UTM)})", None),
        (f"geof:sfIntersects({wkt('POINT(0 0)', UTM)}, {wkt('POINT(8 95)', CRS84)})", None),
        (f"geof:length({wkt('TIN(((0 0,1 1,2 0,0 0)))', CRS84)}, uom:metre)", None),
        (f"geof:getSRID({GML % WGS84})", WGS84),
        (
            f"geof:getSRID({JSON % 'urn:ogc:def:crs:OGC:1.3:CRS84'})",
            "urn:ogc:def:crs:OGC:1.3:CRS84",
        ),
        ('geof:getSRID("no"^^geo:wktLiteral)', None),
        *((f'geof:minX("{text}"^^geo:geoJSONLiteral)', None) for text in ("no", "3", "[1]", " ")),
        ('geof:getSRID(" "^^geo:geoJSONLiteral)', ""),
        ('geof:isEmpty(""^^geo:geoJSONLiteral)', True),
        ('geof:isEmpty("<http://www.opengis.net/def/crs/EPSG/0/4326>"^^geo:wktLiteral)', True),
        (f"geof:minX({JSON % 'urn:ogc:def:crs:OGC:1.3:CRS84'})", 8.0),
        (f"geof:sfEquals({JSON % 'EPSG:4326'}, {wkt('POINT(52 8)', WGS84)})", True),
        (f"geof:minX({JSON % 'EPSG:31467'})", None),
        (f"geof:sfEquals({GML % WGS84}, {wkt('POINT(52 8)', CRS84)})", True),
        (
            f"geof:distance({wkt('POINT(0 0)')}, {wkt('POINT(3 4)')}, "
            '"http://www.opengis.net/def/uom/OGC/1.0/metre"^^xsd:anyURI)',
            5.0,
        ),
        # one in the map's frame, one on the earth; an angle between points of a plane
        (f"geof:distance({wkt('POINT(0 0)')}, {wkt('POINT(3 4)', CRS84)}, uom:metre)", None),
        (f"geof:sfIntersects({wkt('POINT(0 0)')}, {wkt('POINT(0 0)', CRS84)})", None),
        (f"geof:distance({wkt('POINT(0 0)')}, {wkt('POINT(3 4)')}, uom:degree)", None),
        (f"geof:transform({wkt('POINT(0 0)')}, <{UTM}>)", None),
    ],
)
def test_axes_systems_and_units(loft: psycopg.Connection, expression: str, expected: Any) -> None:
    found = value(loft, expression)
    assert found == expected
    assert type(found) is type(expected)


def test_coordinates_are_written_in_the_order_of_the_system(loft: psycopg.Connection) -> None:
    system = f"{CRS}EPSG/0/4258"
    moved = value(loft, f"geof:transform({wkt('POINT(8 52)', CRS84)}, <{system}>)")
    assert str(moved) == f"<{system}> POINT(52 8)"


@pytest.mark.parametrize("z", ["", " 7"])
@pytest.mark.parametrize("system", ["", CRS84, WGS84, UTM])
@pytest.mark.parametrize("function", ["asWKT", "asGML", "asGeoJSON"])
def test_what_is_written_is_read_again(
    loft: psycopg.Connection, system: str, function: str, z: str
) -> None:
    ends = ("400000 5300000", "400100 5300200") if system == UTM else ("48 9", "49 9.5")
    shape = f"LINESTRING{z and ' Z'}({', '.join(end + z for end in ends)})"
    written = f"geof:{function}(geof:intersection({wkt(shape, system)}, {wkt(shape, system)}))"
    end = "geof:distance({}, {}, uom:metre)"
    assert value(loft, end.format(written, wkt(shape, system))) < 1e-3
    assert value(loft, f"geof:is3D({written})") is bool(z)
    length = "geof:length({}, uom:metre)"
    expected = value(loft, length.format(wkt(shape, system)))
    # GeoJSON is in degrees, so that lengths are those on the ellipsoid.
    close = 1e-3 if (function, system) == ("asGeoJSON", UTM) else 1e-6
    assert value(loft, length.format(written)) == pytest.approx(expected, rel=close)


def test_a_buffer_on_the_earth_has_its_radius(loft: psycopg.Connection) -> None:
    point = wkt("POINT(8 52)", CRS84)
    ring = f"geof:boundary(geof:buffer({point}, 2, <{UNIT}KiloM>))"
    assert value(loft, f"geof:distance({ring}, {point}, uom:metre)") == pytest.approx(
        2000, rel=0.01
    )
    assert value(loft, f"geof:metricBuffer({point}, 5)").startswith(f"<{CRS84}> POLYGON")


@pytest.mark.parametrize("unit", ["<http://example.org/furlong>", f"<{UNIT}HA>"])
def test_units_that_are_unknown_are_refused(loft: psycopg.Connection, unit: str) -> None:
    with pytest.raises(QueryError, match=r"is no unit of geof:distance: it knows metre"):
        value(loft, f"geof:distance({wkt('POINT(0 0)')}, {wkt('POINT(3 4)')}, {unit})")


def test_a_unit_of_a_row_that_is_unknown_is_refused(loft: psycopg.Connection) -> None:
    ends = f"{wkt('POINT(0 0)')}, {wkt('POINT(3 4)')}"
    units = "VALUES ?u { uom:metre <http://example.org/furlong> }"
    with pytest.raises(QueryError, match="furlong> is no unit of geof:distance"):
        query(loft, f"SELECT (geof:distance({ends}, ?u) AS ?x) {{ {units} }}")


def test_distances_between_two_systems_are_the_same_from_both(loft: psycopg.Connection) -> None:
    a, b = wkt("POINT(1500000 5300000)", UTM), wkt("POINT(9 48)", CRS84)
    found = value(loft, f"geof:metricDistance({a}, {b})")
    x, y = pyproj.Transformer.from_crs(25832, 4326, always_xy=True).transform(1500000, 5300000)
    assert found == pytest.approx(EARTH.inv(x, y, 9, 48)[2], rel=1e-6)
    assert value(loft, f"geof:metricDistance({b}, {a})") == pytest.approx(found)


@pytest.mark.parametrize(
    "call",
    [
        f"geof:minX({wkt('POINT(1 2)', 'http://example.org/crs')})",
        f"geof:minX({GML % 'http://example.org/crs'})",
        f"geof:transform({wkt('POINT(1 2)', CRS84)}, <http://example.org/crs>)",
    ],
)
def test_a_system_is_named_wherever_it_is(loft: psycopg.Connection, call: str) -> None:
    answer = query(loft, f"SELECT ({call} AS ?x) {{}}")
    assert answer.rows == ((None,),)
    assert "http://example.org/crs" in answer.notes[0]


@pytest.mark.parametrize("code", [31467, 4978, 99999])
def test_systems_whose_axes_are_unknown_are_named(loft: psycopg.Connection, code: int) -> None:
    literal = wkt("POINT(8 52)", f"{CRS}EPSG/0/{code}")
    answer = query(loft, f"SELECT (geof:minX({literal}) AS ?x) {{}}")
    assert answer.rows == ((None,),)
    assert f"EPSG/0/{code}" in answer.notes[0]


def test_geometries_are_put_together_in_one_system(loft: psycopg.Connection) -> None:
    def union(*literals: str) -> Any:
        values = f"VALUES ?g {{ {' '.join(literals)} }}"
        ((found,),) = query(loft, f"SELECT (geof:aggUnion(?g) AS ?x) {{ {values} }}").rows
        return None if found is None else str(found)

    here, there = wkt("POINT(8 52)", CRS84), wkt("POINT(53 8)", WGS84)
    assert union(here, there) == f"<{CRS84}> MULTIPOINT((8 52),(8 53))"
    assert union(wkt("POINT(0 0)"), wkt("POINT(1 0)")) == "MULTIPOINT((0 0),(1 0))"
    assert union(wkt("POINT(0 0)"), here) is None


def test_facts_are_related_within_one_system(loft: psycopg.Connection) -> None:
    facts = {
        "area": wkt("POLYGON((7 51,9 51,9 53,7 53,7 51))", CRS84),
        "town": wkt("POINT(52 8)", WGS84),
        "here": wkt("POINT(8 52)"),
        "far": wkt("POINT(8 52)", WGS84),
    }
    stated = " ".join(f"ex:{name} geo:asWKT {shape} ." for name, shape in facts.items())
    prefix = "PREFIX ex: <http://example.org/>\n"
    update(loft, f"{prefix}INSERT DATA {{ {stated} }}")
    try:
        rows = query(
            loft, f"{prefix}SELECT ?x {{ ex:area geo:sfContains ?x FILTER(?x != ex:area) }}"
        ).rows
        assert {str(x).rpartition("/")[2] for (x,) in rows} == {"town"}
        (truth,) = (query(loft, f"{prefix}ASK {{ ex:here geo:sfDisjoint ex:area }}").truth,)
        assert truth is False, "neither is known"
        assert query(loft, f"{prefix}ASK {{ ex:far geo:sfDisjoint ex:area }}").truth
        assert query(
            loft, f"{prefix}SELECT ?x {{ :table geo:sfDisjoint ?x . ?x geo:asWKT ?w }}"
        ).rows
    finally:
        update(loft, f"{prefix}DELETE DATA {{ {stated} }}")
