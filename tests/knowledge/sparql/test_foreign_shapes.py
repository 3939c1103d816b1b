"""Topological relations of foreign features and geometries are those of Shapely."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine

import semmap
from semmap import Map
from semmap.knowledge.queries import query
from semmap.knowledge.updates import update
from tests.knowledge.sparql.test_geosparql import RELATIONS, SQUARES, Shape, wkt

EX = "http://example.org/"
POINTS = st.builds(shapely.Point, st.integers(0, 4), st.integers(0, 4))
LINES = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=2, unique=True)
SHAPES = SQUARES | POINTS | LINES.map(shapely.LineString).filter(lambda each: each.is_valid)
DRAWN = st.sampled_from(sorted(RELATIONS)).flatmap(
    lambda name: st.tuples(
        st.just(name),
        st.lists(SHAPES if name.startswith("sf") else SQUARES, min_size=2, max_size=5),
    )
)


@pytest.fixture(scope="module")
def yard(module_engine: Engine) -> Iterator[Map]:
    """Squares with whole coordinates, in two maps."""
    with semmap.connect(module_engine.url.render_as_string(hide_password=False)) as database:
        for name in ("other", "yard"):
            made = database.create_map(name)
            for x, y in ((1, 1), (3, 1), (2, 2)):
                made.add_object(f"crate{x}{y}", type="box", size=(2, 2, 1), pose=(x, y, 0))
        yield made


def stated(shapes: list[Shape], prefix: str) -> str:
    """Return features, each second with a default geometry, and their geometries."""
    return "".join(
        f"ex:{prefix}{i} geo:has{'Default' * (i % 2)}Geometry ex:{prefix}g{i} . "
        f"ex:{prefix}g{i} geo:asWKT {wkt(shape)} . "
        for i, shape in enumerate(shapes)
    )


def pairs(yard: Map, pattern: str) -> list[tuple[str, ...]]:
    answer = query(yard.connection, f"PREFIX ex: <{EX}> SELECT * {{ {pattern} }}")
    return sorted(tuple(map(str, row)) for row in answer.rows)


def named(shapes: list[Shape], prefix: str) -> dict[str, Shape]:
    return {f"{EX}{prefix}{g}{i}": each for i, each in enumerate(shapes) for g in ("", "g")}


def of_shapely(name: str, shapes: dict[str, Shape]) -> list[tuple[str, str]]:
    holds = RELATIONS[name]
    return sorted((a, b) for a, b in product(shapes, repeat=2) if holds(shapes[a], shapes[b]))


@settings(
    max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(drawn=DRAWN)
def test_relations_are_those_of_shapely(yard: Map, drawn: tuple[str, list[Shape]]) -> None:
    name, shapes = drawn
    session = yard.connection
    graphs = {"ex:one": shapes[1:], "ex:two": shapes[:1]}
    own = own_shapes(yard)
    with session.transaction(force_rollback=True):
        of_graphs = " ".join(f"GRAPH {g} {{ {stated(s, g[3:])} }}" for g, s in graphs.items())
        update(session, f"PREFIX ex: <{EX}> INSERT DATA {{ {stated(shapes, 'f')} {of_graphs} }}")
        every = of_shapely(name, own | named(shapes, "f"))
        assert pairs(yard, f"?a geo:{name} ?b") == every
        for end in (f"{EX}f0", next(iter(own))):
            found = pairs(yard, f"?a geo:{name} <{end}>")
            assert found == [(a,) for a, b in every if b == end]
        of_graph = {g: of_shapely(name, named(s, g[3:])) for g, s in graphs.items()}
        assert pairs(yard, f"GRAPH ex:one {{ ?a geo:{name} ?b }}") == of_graph["ex:one"]
        both = sorted((EX + g[3:], *pair) for g, found in of_graph.items() for pair in found)
        assert pairs(yard, f"GRAPH ?g {{ ?a geo:{name} ?b }}") == both


def own_shapes(yard: Map) -> dict[str, Shape]:
    text = "SELECT ?x ?g ?w { ?x geo:hasDefaultGeometry ?g . ?g geo:asWKT ?w }"
    rows = query(yard.connection, text).rows
    return {str(each): shapely.from_wkt(str(w)) for x, g, w in rows for each in (x, g)}


def test_a_pair_is_one_answer(yard: Map) -> None:
    """However many geometries a feature has, and where the relation is stated, too."""
    facts = f"""
        ex:land geo:hasGeometry ex:a, ex:b .
        ex:hut geo:hasDefaultGeometry ex:c ; geo:hasGeometry ex:far .
        ex:hut geo:sfWithin ex:land, ex:town .
        ex:a geo:asWKT {wkt(shapely.box(0, 0, 9, 9))}, {wkt(shapely.box(-1, -1, 9, 9))} .
        ex:b geo:asWKT {wkt(shapely.box(0, 0, 8, 8))} .
        ex:c geo:asWKT {wkt(shapely.Point(4, 4))} .
        ex:far geo:asWKT {wkt(shapely.Point(99, 99))} .
    """
    with yard.connection.transaction(force_rollback=True):
        update(
            yard.connection, f"PREFIX ex: <{EX}> INSERT DATA {{ {facts} GRAPH ex:g {{ {facts} }} }}"
        )
        for graph in ("", "GRAPH ex:g"):
            found = pairs(yard, f"{graph} {{ ex:hut geo:sfWithin ?x }}")
            assert [x.removeprefix(EX) for (x,) in found if EX in x] == sorted(
                ["a", "b", "c", "hut", "land", "town"]
            )
            assert pairs(yard, f"{graph} {{ ex:hut geo:sfWithin ex:far }}") == []


@pytest.mark.parametrize(
    "text",
    [
        "no WKT",
        "POINT(inf 0)",
        "POLYGON((0 0, 4 4, 4 0, 0 4, 0 0))",
        "POLYHEDRALSURFACE(((0 0 0, 1 0 0, 1 1 0, 0 0 0)))",
    ],
)
def test_an_invalid_geometry_has_no_relation(yard: Map, text: str) -> None:
    with yard.connection.transaction(force_rollback=True):
        update(
            yard.connection,
            f'PREFIX ex: <{EX}> INSERT DATA {{ ex:wrong geo:asWKT "{text}"^^geo:wktLiteral . '
            'ex:right geo:asWKT "POINT(9 9)"^^geo:wktLiteral }',
        )
        for name in ("sfIntersects", "sfDisjoint"):
            found = pairs(yard, f"ex:wrong geo:{name} ?x") + pairs(yard, f"?x geo:{name} ex:wrong")
            assert found == [], name
        assert (f"{EX}right",) in pairs(yard, ":crate11 geo:sfDisjoint ?x")


POINTS_IN_A_GRID = """
INSERT INTO statement (map_id, subject, predicate, object, tag)
SELECT current_map(), 'http://example.org/p' || n, 'http://www.opengis.net/ont/geosparql#asWKT',
       format('POINT(%s %s)', n % 100, n / 100), 'http://www.opengis.net/ont/geosparql#wktLiteral'
FROM generate_series(0, 4999) n
"""


@pytest.mark.parametrize("pattern", ["?x geo:sfWithin :crate11", ":crate11 geo:sfContains ?x"])
def test_an_index_answers_the_relations(yard: Map, pattern: str) -> None:
    session = yard.connection
    scans = "SELECT pg_stat_get_xact_numscans('term_shape'::regclass)"
    with session.transaction(force_rollback=True):
        session.execute(POINTS_IN_A_GRID)
        session.execute("ANALYZE term; ANALYZE triple")
        before = session.execute(scans).fetchone()
        assert (f"{EX}p101",) in pairs(yard, pattern)
        assert session.execute(scans).fetchone() > before
        joined = "?x semmap:name 'crate11' . ?y ex:in ex:town . ?y geo:sfWithin ?x"
        update(session, f"PREFIX ex: <{EX}> INSERT DATA {{ ex:p101 ex:in ex:town }}")
        assert [y for _, y in pairs(yard, joined)] == [f"{EX}p101"]


def test_a_query_without_foreign_geometries_reads_no_statements(yard: Map) -> None:
    (sql,) = query(yard.connection, "SELECT ?x { ?x geo:sfWithin :crate11 }").explanation
    assert "triple" not in sql.partition("\n--")[0]
