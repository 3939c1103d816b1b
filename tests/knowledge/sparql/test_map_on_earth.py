"""Entities of a map with a georeference, and literals in reference systems, beside pyproj."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from shapely.affinity import affine_transform
from sqlalchemy import Engine

import semmap
from semmap import Map
from semmap.knowledge.queries import query
from semmap.knowledge.updates import update

EAST, NORTH, TURN = 434000.0, 5792000.0, 0.4
CRS = "http://www.opengis.net/def/crs/"
SYSTEMS = {  # the EPSG code, whether the first coordinate is the northern one
    f"{CRS}OGC/1.3/CRS84": (4326, False),
    f"{CRS}EPSG/0/4326": (4326, True),
    f"{CRS}EPSG/0/32632": (32632, False),
    "urn:ogc:def:crs:EPSG::32633": (32633, False),
}
RELATIONS: dict[str, Callable[[Any, Any], bool]] = {
    "sfIntersects": shapely.intersects,
    "sfWithin": shapely.within,
    "sfContains": shapely.contains,
    "sfDisjoint": shapely.disjoint,
}
IN_ONE = 1e-3  # metres: nearer borders may be on either side after a transformation
PREFIX = "PREFIX ex: <http://example.org/> "

spots = st.floats(-6, 6)
boxes = st.builds(
    lambda x, y, width, depth: shapely.box(x, y, x + width, y + depth),
    *(spots, spots, st.floats(0.1, 8), st.floats(0.1, 8)),
)


@pytest.fixture(scope="module")
def campus(module_engine: Engine) -> Iterator[Map]:
    """Crates on the earth, beside a map of the same that lies elsewhere."""
    with semmap.connect(module_engine.url.render_as_string(hide_password=False)) as database:
        for name, east in (("elsewhere", EAST + 500), ("campus", EAST)):
            made = database.create_map(name)
            for i, (x, y) in enumerate([(0, 0), (3, 1), (-4, 2), (40, 40)]):
                made.add_object(f"crate{i}", type="box", size=(2, 1, 1), pose=(x, y, 0, i))
            made.execute(
                "UPDATE map SET crs = 32632, easting = %s, northing = %s, height = 70, "
                "rotation = %s WHERE id = current_map()",
                east,
                NORTH,
                TURN,
            )
        yield made


def on_earth(shape: Any, code: int) -> Any:
    """Return a shape of the map's frame in a system, east first."""
    cos, sin = np.cos(TURN), np.sin(TURN)
    placed = affine_transform(shape, [cos, -sin, sin, cos, EAST, NORTH])
    move = pyproj.Transformer.from_crs(32632, code, always_xy=True).transform
    return shapely.transform(placed, lambda xy: np.column_stack(move(xy[:, 0], xy[:, 1])))


def literals(shape: Any) -> Iterator[tuple[str, str]]:
    """Yield the property and the literal of a shape in each system and format."""
    for system, (code, north_first) in SYSTEMS.items():
        moved = on_earth(shape, code)
        if north_first:
            moved = shapely.transform(moved, lambda xy: xy[:, ::-1])
        yield "geo:asWKT", f'"<{system}> {shapely.to_wkt(moved, 12)}"^^geo:wktLiteral'
        text = " ".join(f"{v!r}" for at in moved.exterior.coords for v in map(float, at))
        gml = (
            f"<gml:Polygon xmlns:gml='http://www.opengis.net/gml/3.2' srsName='{system}'>"
            f"<gml:exterior><gml:LinearRing><gml:posList>{text}</gml:posList></gml:LinearRing>"
            "</gml:exterior></gml:Polygon>"
        )
        yield "geo:asGML", f'"{gml}"^^geo:gmlLiteral'
    degrees = {
        **shapely.geometry.mapping(on_earth(shape, 4326)),
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}},
    }
    yield "geo:asGeoJSON", f"'{json.dumps(degrees)}'^^geo:geoJSONLiteral"


def crates(campus: Map) -> dict[str, Any]:
    text = "SELECT ?x ?w { ?x a semmap:Object ; geo:hasGeometry/geo:asWKT ?w }"
    return {str(x): shapely.from_wkt(str(w)) for x, w in query(campus.connection, text).rows}


@settings(
    max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(zone=boxes, name=st.sampled_from(sorted(RELATIONS)))
def test_relations_between_the_map_and_the_earth(campus: Map, zone: Any, name: str) -> None:
    own = crates(campus)
    assert len(own) == 4
    holds = RELATIONS[name]
    for other in (zone.buffer(IN_ONE), zone.buffer(-IN_ONE)):
        assume(all(holds(each, other) == holds(each, zone) for each in own.values()))
    session = campus.connection
    with session.transaction(force_rollback=True):
        facts = "".join(
            f"ex:z{i} {verb} {text} . ex:f{i} geo:hasGeometry ex:z{i} . "
            for i, (verb, text) in enumerate(literals(zone))
        )
        update(session, f"{PREFIX} INSERT DATA {{ {facts} }}")
        expected = sorted(each for each, shape in own.items() if holds(shape, zone))
        of_each: dict[str, list[str]] = {}
        answer = query(
            session,
            f"{PREFIX} SELECT ?z ?x {{ ?x a semmap:Object ; geo:{name} ?z . "
            "FILTER(STRSTARTS(STR(?z), 'http://example.org/')) }",
        )
        for z, x in answer.rows:
            of_each.setdefault(str(z), []).append(str(x))
        zones = [f"http://example.org/{kind}{i}" for kind in "zf" for i in range(9)]
        assert {z: sorted(of_each.get(z, [])) for z in zones} == dict.fromkeys(zones, expected)
        converse = {"sfWithin": "sfContains", "sfContains": "sfWithin"}.get(name, name)
        for i in (1, 3, 8):
            found = query(
                session, f"{PREFIX} SELECT ?x {{ ex:f{i} geo:{converse} ?x . ?x a semmap:Object }}"
            )
            assert sorted(str(x) for (x,) in found.rows) == expected
    for _, text in literals(zone):
        found = query(
            session,
            f"SELECT ?x {{ ?x a semmap:Object ; geo:hasGeometry/geo:asWKT ?w "
            f"FILTER(geof:{name}(?w, {text})) }}",
        )
        assert sorted(str(x) for (x,) in found.rows) == expected


@settings(
    max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(zone=boxes)
def test_distances_between_the_map_and_the_earth(campus: Map, zone: Any) -> None:
    own = crates(campus)
    far = 5.0
    away = {each: shapely.distance(shape, zone) for each, shape in own.items()}
    assume(all(abs(metres - far) > IN_ONE for metres in away.values()))
    where = "?x a semmap:Object ; geo:hasGeometry/geo:asWKT ?w"
    for _, text in literals(zone):
        found = query(
            campus.connection,
            f"SELECT ?x (geof:distance(?w, {text}, uom:metre) AS ?d) "
            f"(geof:distance(?w, geof:transform({text}, <urn:ogc:def:crs:EPSG::0>)) AS ?e) "
            f"{{ {where} }}",
        )
        assert {str(x): float(d) for x, d, _ in found.rows} == pytest.approx(away, abs=IN_ONE)
        near = query(
            campus.connection,
            f"SELECT ?x {{ {where} FILTER(geof:distance(?w, {text}, uom:metre) < {far}) }}",
        )
        assert {str(x) for (x,) in near.rows} == {x for x, metres in away.items() if metres < far}


def test_a_footprint_is_transformed_and_put_together_with_the_earth(campus: Map) -> None:
    (x,) = (each for each in crates(campus) if each.endswith("crate1"))
    ((moved, both),) = query(
        campus.connection,
        "SELECT (geof:transform(?w, <http://www.opengis.net/def/crs/EPSG/0/32632>) AS ?m) "
        f"(geof:intersection(?w, ?m) AS ?both) {{ <{x}> geo:hasGeometry/geo:asWKT ?w }}",
    ).rows
    expected = on_earth(crates(campus)[x], 32632)
    found = shapely.from_wkt(str(moved).partition("> ")[2])
    assert found.symmetric_difference(expected).area < 1e-6
    assert shapely.area(shapely.from_wkt(str(both))) == pytest.approx(2, abs=1e-6)


AT_ORIGIN = {
    "wkt": '"POINT(0 0)"^^geo:wktLiteral',
    "wkt of the frame": '"<http://www.opengis.net/def/crs/EPSG/0/0> POINT(0 0)"^^geo:wktLiteral',
    "gml of the frame": "\"<gml:Point xmlns:gml='http://www.opengis.net/gml' "
    "srsName='urn:ogc:def:crs:EPSG::0'><gml:pos>0 0</gml:pos></gml:Point>\"^^geo:gmlLiteral",
    "geojson": '\'{"type": "Point", "coordinates": [0, 0], "crs": null}\'^^geo:geoJSONLiteral',
}


@pytest.mark.parametrize("kind", AT_ORIGIN)
@pytest.mark.parametrize("georeferenced", [True, False])
def test_literals_of_the_frame_have_their_relations(
    campus: Map, kind: str, georeferenced: bool
) -> None:
    session = campus.connection
    with session.transaction(force_rollback=True):
        if not georeferenced:
            campus.execute(NO_GEOREFERENCE)
        update(session, f"{PREFIX} INSERT DATA {{ ex:here geo:asWKT {AT_ORIGIN[kind]} }}")
        answer = query(
            session, f"{PREFIX} SELECT ?x {{ ?x a semmap:Object ; geo:sfContains ex:here }}"
        )
        assert [str(x).rpartition("#")[2] for (x,) in answer.rows] == ["crate0"]
        assert answer.notes == ()


@pytest.mark.parametrize("size", [0.5, 6.0])
def test_long_edges_are_curved_in_degrees(campus: Map, size: float) -> None:
    """A parallel lies north of the straight line between its ends."""
    session, own = campus.connection, crates(campus)
    middle = on_earth(shapely.Point(0, 0), 4326)
    low, top = middle.y - size, middle.y - 1e-4 * size**2
    zone = shapely.box(middle.x - size, low, middle.x + size, top)
    text = f'"<{CRS}OGC/1.3/CRS84> {zone.wkt}"^^geo:wktLiteral'
    placed = shapely.transform(zone, in_frame)
    expected = sorted(each for each, shape in own.items() if shapely.within(shape, placed))
    with session.transaction(force_rollback=True):
        update(session, f"{PREFIX} INSERT DATA {{ ex:big geo:asWKT {text} }}")
        found = query(session, f"{PREFIX} SELECT ?x {{ ?x a semmap:Object ; geo:sfWithin ex:big }}")
        assert sorted(str(x) for (x,) in found.rows) == expected
    where = "?x a semmap:Object ; geo:hasGeometry/geo:asWKT ?w"
    found = query(session, f"SELECT ?x {{ {where} FILTER(geof:sfWithin(?w, {text})) }}")
    assert sorted(str(x) for (x,) in found.rows) == expected
    assert expected


def in_frame(xy: Any) -> Any:
    """Bring longitudes and latitudes into the map's frame."""
    to_utm = pyproj.Transformer.from_crs(4326, 32632, always_xy=True).transform
    east, north = (np.asarray(v) for v in to_utm(xy[:, 0], xy[:, 1]))
    cos, sin = np.cos(TURN), np.sin(TURN)
    return np.column_stack(
        [
            cos * (east - EAST) + sin * (north - NORTH),
            -sin * (east - EAST) + cos * (north - NORTH),
        ]
    )


def test_heights_are_above_the_height_of_the_frame(campus: Map) -> None:
    at = on_earth(shapely.Point(0, 0), 4326)
    here = f'"<{CRS}OGC/1.3/CRS84> POINT Z ({at.x!r} {at.y!r} 75)"^^geo:wktLiteral'
    there = '"POINT Z (0 0 5)"^^geo:wktLiteral'
    to = f"geof:transform({{}}, <{CRS}EPSG/0/{{}}>)"
    ((down, up, away),) = query(
        campus.connection,
        f"SELECT (geof:maxZ({to.format(here, 0)}) AS ?down) (geof:maxZ({to.format(there, 4326)}) "
        f"AS ?up) (semmap:distance3D({there}, {here}) AS ?away) {{}}",
    ).rows
    assert (float(down), float(up)) == pytest.approx((5, 75))
    assert float(away) < IN_ONE


@pytest.mark.parametrize("code", [4326, 2263, 99999])
def test_a_georeference_in_other_units_is_none(campus: Map, code: int) -> None:
    session = campus.connection
    with session.transaction(force_rollback=True):
        campus.execute("UPDATE map SET crs = %s WHERE id = current_map()", code)
        answer = query(
            session,
            "SELECT ?x { ?x geo:hasGeometry/geo:asWKT ?w "
            f"FILTER(geof:sfDisjoint(?w, {FOREIGN})) }}",
        )
        assert answer.rows == ()
        assert "no georeference" in answer.notes[0]


NO_GEOREFERENCE = (
    "UPDATE map SET crs = NULL, easting = NULL, northing = NULL, height = NULL, "
    "rotation = NULL WHERE id = current_map()"
)
FOREIGN = '"<http://www.opengis.net/def/crs/OGC/1.3/CRS84> POINT(8 52)"^^geo:wktLiteral'


def test_what_is_not_related_is_noted(campus: Map) -> None:
    session = campus.connection
    asked = "SELECT * { ?x geo:sfContains ex:there }"
    with session.transaction(force_rollback=True):
        assert query(session, PREFIX + asked).notes == ()
        update(session, f"{PREFIX} INSERT DATA {{ ex:there geo:asWKT {FOREIGN} }}")
        assert query(session, PREFIX + asked).notes == ()
        here = '"POINT(0 0)"^^geo:wktLiteral'
        update(session, f"{PREFIX} INSERT DATA {{ ex:here geo:asWKT {here} }}")
        (note,) = query(session, PREFIX + asked).notes
        assert "foreign geometries in the map's frame are not compared" in note
        for name in ("sfContains", "sfDisjoint", "sfEquals"):
            pairs = f"{PREFIX} SELECT * {{ ex:here geo:{name} ex:there }}"
            assert query(session, pairs).rows == ()
        campus.execute(NO_GEOREFERENCE)
        notes = query(session, PREFIX + asked).notes
        assert "no georeference" in notes[0]
        assert query(session, f"{PREFIX} SELECT * {{ ?x geo:asWKT ?w }} LIMIT 1").notes == ()


POINTS_AROUND = """
INSERT INTO statement (map_id, subject, predicate, object, tag)
SELECT current_map(), 'http://example.org/p' || n, 'http://www.opengis.net/ont/geosparql#asWKT',
       format('<http://www.opengis.net/def/crs/OGC/1.3/CRS84> POINT(%%s %%s)',
              %s::float8 + 0.001 * (n %% 50), %s::float8 + 0.001 * (n / 50)),
       'http://www.opengis.net/ont/geosparql#wktLiteral'
FROM generate_series(0, 2499) n
"""


@pytest.mark.parametrize("pattern", ["?x geo:sfWithin :crate0", ":crate0 geo:sfContains ?x"])
def test_an_index_answers_relations_to_the_earth(campus: Map, pattern: str) -> None:
    session = campus.connection
    at = on_earth(shapely.Point(0, 0), 4326)
    with session.transaction(force_rollback=True):
        campus.execute(POINTS_AROUND, at.x, at.y)
        session.execute("ANALYZE term; ANALYZE triple")
        text = f"SELECT ?x {{ {pattern} FILTER(CONTAINS(STR(?x), 'example')) }}"
        answer = query(session, text, plan=True)
        assert [str(x) for (x,) in answer.rows] == ["http://example.org/p0"]
        plan = next(part for part in answer.explanation if part.kind == "plan")
        removed = re.findall(r"Rows Removed by [\w ]+: (\d+)", plan)
        assert max(map(int, removed), default=0) < 100
