"""INSERT and DELETE on a region map, against sets of voxels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.fields import Box, Cone, Cylinder, Hull, RegionMap, Sphere, voxels_of
from semmap.fields.queries import QueryError, update
from semmap.fields.regions.region_text import FORMS, read_region
from semmap.fields.regions.shaped_region import Region
from tests.fields.queries.arrays import PREFIX, Arrays, kitchen
from tests.oracles.region_map import check_region_map

SIZE = 0.5
TURN = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
REGIONS: dict[str, Region] = {
    "SPHERE(1 2 -3 1.5)": Sphere((1, 2, -3), 1.5),
    " sphere ( 1.0, 2 -3e0 1.5 ) ": Sphere((1, 2, -3), 1.5),
    "BOX(1 1 1 2 3 4)": Box((1, 1, 1), (2, 3, 4)),
    f"BOX(1 1 1 2 3 4 0 0 {TURN[2]} {TURN[3]})": Box((1, 1, 1), (2, 3, 4), TURN),
    "CYLINDER(0 0 1 1 2)": Cylinder((0, 0, 1), 1, 2),
    "CYLINDER(0 0 1 1 2 1 0 0)": Cylinder((0, 0, 1), 1, 2, (1, 0, 0)),
    "CONE(0 0 1.6 1 0 0 0.5 5)": Cone((0, 0, 1.6), (1, 0, 0), 0.5, 5),
    "HULL(0 0 0, 2 0 0, 0 2 0, 0 0 2)": Hull([(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2)]),
    "POINTS(0.1 0.1 0.1, 5 5 5)": np.array([[0.1, 0.1, 0.1], [5, 5, 5]]),
    "POINTS()": np.zeros((0, 3)),
}


def voxels(region: Region) -> set[tuple[int, ...]]:
    return {tuple(v) for v in voxels_of(region, SIZE).tolist()}


def state(regions: RegionMap) -> dict[Any, set[tuple[int, ...]]]:
    check_region_map(regions._native)
    return {e: {tuple(v) for v in regions.voxels(e).tolist()} for e in regions.entities()}


def literal(text: str) -> str:
    return f'"{text}"^^:region'


@pytest.mark.parametrize("text", REGIONS)
def test_a_text_is_read_as_its_region(text: str) -> None:
    assert voxels(read_region(text)) == voxels(REGIONS[text])
    regions = RegionMap(SIZE)
    update(regions, f"{PREFIX} INSERT DATA {{ :a :occupies {literal(text)} }}")
    assert state(regions) == ({"a": voxels(REGIONS[text])} if voxels(REGIONS[text]) else {})


def test_every_form_has_an_example() -> None:
    assert {text.split("(")[0].strip().upper() for text in REGIONS} == set(FORMS)


def filled() -> RegionMap:
    regions = RegionMap(SIZE)
    regions.insert("a", Box((0, 0, 0), (4, 4, 4)))
    regions.insert("b", Box((2, 0, 0), (4, 4, 4)))
    regions.insert(7, Sphere((9, 9, 9), 1))
    return regions


A, B = voxels(Box((0, 0, 0), (4, 4, 4))), voxels(Box((2, 0, 0), (4, 4, 4)))
SEVEN = voxels(Sphere((9, 9, 9), 1))
BALL = voxels(Sphere((0, 0, 0), 1))
S = literal("SPHERE(0 0 0 1)")

CHANGES: dict[str, dict[Any, set[tuple[int, ...]]]] = {
    f"INSERT DATA {{ :c :occupies {S} }}": {"a": A, "b": B, 7: SEVEN, "c": BALL},
    f"INSERT DATA {{ c :occupies {S} . :b :occupies {S} }}": {
        "a": A,
        "b": B | BALL,
        7: SEVEN,
        "c": BALL,
    },
    f"DELETE DATA {{ :a :occupies {S} }}": {"a": A - BALL, "b": B, 7: SEVEN},
    f"DELETE DATA {{ :nobody :occupies {S} }}": {"a": A, "b": B, 7: SEVEN},
    "DELETE WHERE { :a :occupies ?v }": {"b": B, 7: SEVEN},
    "DELETE WHERE { '7' :occupies ?v }": {"a": A, "b": B},
    "DELETE WHERE { ?x :occupies ?v }": {},
    "DELETE { :a :occupies ?v } WHERE { :a :occupies ?v . :b :occupies ?v }": {
        "a": A - B,
        "b": B,
        7: SEVEN,
    },
    "DELETE { ?x :occupies ?v } WHERE { ?x :occupies ?v FILTER(:x(?v) < 0) }": {
        "a": {v for v in A if v[0] >= 0},
        "b": {v for v in B if v[0] >= 0},
        7: SEVEN,
    },
    "DELETE { :a :occupies ?v } INSERT { :b :occupies ?v } WHERE { :a :occupies ?v }": {
        "b": A | B,
        7: SEVEN,
    },
    f"INSERT {{ ?x :occupies {S} }} WHERE {{ ?x :occupies ?v FILTER(:z(?v) > 5) }}": {
        "a": A,
        "b": B,
        7: SEVEN | BALL,
    },
    f"INSERT DATA {{ :c :occupies {S} }} ; DELETE WHERE {{ :c :occupies ?v }}": {
        "a": A,
        "b": B,
        7: SEVEN,
    },
    "INSERT { :c :occupies ?v } WHERE { :a :occupies ?v FILTER(:x(?v) > 90) }": {
        "a": A,
        "b": B,
        7: SEVEN,
    },
    "": {"a": A, "b": B, 7: SEVEN},
}


@pytest.mark.parametrize("text", CHANGES)
def test_an_update_changes_the_voxels_of_its_entities(text: str) -> None:
    regions = filled()
    before = state(regions)
    done = update(regions, PREFIX + text)
    after = state(regions)
    assert after == CHANGES[text]
    names = {str(e) for e in {*before, *after} if before.get(e) != after.get(e)}
    assert names <= done.changed
    assert not done.new


def test_blank_nodes_get_unused_names() -> None:
    regions = RegionMap(SIZE)
    regions.insert("region2", Sphere((9, 9, 9), 1))
    text = f"INSERT DATA {{ _:new :occupies {S} . _:old :occupies {S} . [] :occupies {S} }}"
    done = update(regions, PREFIX + text)
    assert done.new == {"new": "region1", "old": "region3", "[1]": "region4"}
    assert set(state(regions)) == {"region1", "region2", "region3", "region4"}
    assert update(regions, PREFIX + text).new["new"] == "region5"


def test_a_zone_is_made_of_the_voxels_that_a_query_binds() -> None:
    catalogue, regions = kitchen(), RegionMap(SIZE)
    done = update(
        regions,
        PREFIX + "INSERT { _:zone :occupies ?v } WHERE { ?v :inFieldOfView human1 ; "
        ":containsObject 'mug' }",
        catalogue,
    )
    assert done.new == {"zone": "region1"}
    assert state(regions) == {"region1": {(4, 4, 2), (4, 4, 3)}}
    update(
        regions,
        PREFIX + "INSERT { ?who :occupies ?v } WHERE { :region1 :occupies ?v . "
        "?v :inFieldOfView ?who }",
        catalogue,
    )
    assert state(regions)["human2"] == {(4, 4, 3)}


WRONG = {
    "INSERT DATA { :a »:fills 'x' }": "only :occupies can be inserted and deleted",
    "INSERT DATA { :a :occupies »'SPHERE(0 0 0 1)' }": "this is not a region: write",
    'INSERT DATA { :a :occupies »"BALL(0 0 0 1)"^^:region }': "not a region: write SPHERE, BOX",
    'INSERT DATA { :a :occupies »"SPHERE(0 0 1)"^^:region }': "SPHERE has 3 numbers: write SPHERE(",
    'INSERT DATA { :a :occupies »"SPHERE(0 0 0 -1)"^^:region }': "give metres above 0",
    'INSERT DATA { :a :occupies »"SPHERE(0 0 0 one)"^^:region }': "could not convert string to flo",
    'INSERT DATA { :a :occupies »"HULL(0 0 0, 1 1)"^^:region }': "HULL takes points of three numbe",
    'INSERT DATA { :a :occupies »"POINTS(0 0 nan)"^^:region }': "holds NaN or infinity",
    f"DELETE DATA {{ »_:a :occupies {S} }}": "a blank node is allowed in INSERT only",
    "DELETE WHERE { »:nobody :occupies ?v }": "the region map has no entity nobody",
    f"DELETE WHERE {{ :a :occupies »{S} }}": "is a voxel, which has no name",
    "INSERT { :c :occupies »?w } WHERE { :a :occupies ?v }": "?w is not bound by any pattern",
    "INSERT { »?v :occupies ?v } WHERE { :a :occupies ?v }": "this has to be an entity, and ?v is",
    "INSERT { :c :occupies »?x } WHERE { ?x :occupies ?v }": "this has to be a voxel, and ?x is a",
    "INSERT { :c :occupies ?v } WHERE { ?v »:free ?b }": "there is no property",
    "»CLEAR ALL": "CLEAR is not supported: use INSERT and DELETE",
    "»WITH :g DELETE { :a :occupies ?v } WHERE { :a :occupies ?v }": "WITH is not supported",
    "INSERT DATA { »GRAPH :g { :a :occupies 'x' } }": "GRAPH is not supported",
    "INSERT DATA { :a »}": "not SPARQL",
}
"""Texts with » before the wrong part, and part of the reason."""


@pytest.mark.parametrize("text", WRONG)
def test_a_bad_update_changes_nothing(text: str) -> None:
    regions = filled()
    before = state(regions)
    good = f"INSERT DATA {{ _:n :occupies {S} }} ; DELETE WHERE {{ :b :occupies ?v }}"
    whole = f"{PREFIX}{good} ;\n{text.replace('»', '')}"
    with pytest.raises(QueryError) as caught:
        update(regions, whole)
    assert WRONG[text] in caught.value.reason
    assert (caught.value.line, caught.value.column) == (3, text.index("»") + 1)
    assert state(regions) == before


def test_voxels_of_another_size_are_refused() -> None:
    with pytest.raises(ValueError, match=r"0\.5 m, the region map of 0\.1 m"):
        update(RegionMap(0.1), PREFIX + "DELETE WHERE { ?x :occupies ?v }", Arrays([]))


names = st.sampled_from(["a", "b", "c"])
places = st.tuples(*(st.integers(-3, 3),) * 3)
boxes = st.tuples(places, st.integers(1, 4)).map(
    lambda b: ("BOX({} {} {} {s} {s} {s})".format(*b[0], s=b[1]), Box(b[0], (b[1],) * 3))
)


@settings(max_examples=12)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.sampled_from(["INSERT", "DELETE"]), names, boxes),
            st.tuples(st.sampled_from(["both", "all"]), names, names),
        ),
        max_size=6,
    ),
    st.booleans(),
)
def test_updates_equal_operations_on_sets(changes: list[tuple[str, str, Any]], fail: bool) -> None:
    """An error at the end undoes all requests."""
    regions = RegionMap(SIZE)
    every = literal("SPHERE(0 0 0 1)")
    model = {name: set(BALL) for name in "abc"}
    triples = " . ".join(f":{name} :occupies {every}" for name in "abc")
    update(regions, f"{PREFIX} INSERT DATA {{ {triples} }}")
    requests = []
    for kind, name, of in changes:
        if kind == "INSERT":
            model[name] |= voxels(of[1])
            requests.append(f"INSERT DATA {{ :{name} :occupies {literal(of[0])} }}")
        elif kind == "DELETE":
            model[name] -= voxels(of[1])
            requests.append(f"DELETE DATA {{ :{name} :occupies {literal(of[0])} }}")
        else:
            both = model[name] & model[of]
            model[name] -= both
            requests.append(
                f"DELETE {{ ?x :occupies ?v }} WHERE {{ ?x :occupies ?v . ?y :occupies ?v "
                f"FILTER(STR(?x) = '{name}' && STR(?y) = '{of}') }}"
            )
    if fail:
        with pytest.raises(QueryError):
            update(regions, PREFIX + " ; ".join([*requests, "DELETE WHERE { :z :occupies ?v }"]))
        assert state(regions) == dict.fromkeys("abc", BALL)
    else:
        update(regions, PREFIX + " ; ".join(requests))
        assert state(regions) == {name: each for name, each in model.items() if each}
