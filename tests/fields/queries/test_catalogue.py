"""The statements of maps, now and in the past; the maps that STORE makes."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest

from semmap.database.files import schema_folder
from semmap.fields.maps.grids import ValueType
from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import read_vocabulary
from semmap.fields.queries import StoreResult, query
from semmap.fields.queries.catalogue import RDF_TYPE, FieldCatalogue
from semmap.fields.queries.columns import (
    Demand,
    Entities,
    Numbers,
    Statements,
    VoxelColumn,
)
from semmap.fields.regions.region_map import NamedRegionMap, RegionMap
from semmap.fields.regions.shaped_region import Box, Sphere, voxels_of
from semmap.geometry.voxel_keys import keys_of, voxels_of_keys
from semmap.ingest.ontology.tbox import read_tbox
from semmap.language.names import NameIndex
from semmap.snake_case import snake_case

ONTOLOGY = schema_folder() / "ontology"
VOCABULARY = read_vocabulary([ONTOLOGY / "fields.ttl"])
TYPES = read_tbox(sorted(ONTOLOGY.glob("*.ttl")))
SUPERTYPES: dict[str, frozenset[str]] = {}
for each_type in TYPES:  # each after its parents
    SUPERTYPES[each_type.name] = frozenset({each_type.name}).union(
        *(SUPERTYPES[parent] for parent in each_type.parents)
    )
NAMES = NameIndex(
    {"mug1": "mug", "desk1": "desk", "anna": "person"},
    SUPERTYPES,
    {snake_case(word): t.name for t in TYPES for word in (t.label, *t.synonyms)},
)
NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)
SIZE = 0.05
BALL, OTHER = Sphere((0, 0, 1), 0.3), Sphere((0.3, 0, 1), 0.3)
PREFIX = "PREFIX : <urn:semmap:ontology#> "


def made(name: str, *regions: Any, kind: ValueType = "bool", **more: Any) -> RepresentationMap:
    pairs = [each if isinstance(each, tuple) else (each, True) for each in regions]
    return RepresentationMap.of_regions(VOCABULARY[name], pairs, SIZE, value_type=kind, **more)


def rows(stated: Statements) -> set[tuple[Any, ...]]:
    """Return voxels as triples of integers, and entities by name."""

    def plain(column: Any) -> list[Any]:
        if isinstance(column, VoxelColumn):
            return [tuple(v) for v in voxels_of_keys(column.keys).tolist()]
        if isinstance(column, Entities):
            return [column.names[code] for code in column.codes]
        return [round(v, 5) for v in column.values.tolist()]

    found = list(zip(plain(stated.subject), plain(stated.object), strict=True))
    assert len(found) == len(set(found)), "each row once"
    return set(found)


def cells(region: Any) -> set[tuple[int, ...]]:
    return {tuple(v) for v in voxels_of(region, SIZE).tolist()}


@pytest.fixture
def maps() -> MapBuffer:
    kept = MapBuffer(timedelta(minutes=5))
    graded = made("inFieldOfView", (OTHER, 0.25), kind="float32", about="anna")
    kept.put("gaze", [made("inFieldOfView", BALL, about="human1"), graded], NOW)
    legend = {1: "mug", 2: "teddy", 3: "teacup"}
    kept.put(
        "objects", [made("containsObject", (BALL, 1), (OTHER, 2), kind="int32", legend=legend)], NOW
    )
    room = Box((0, 0, 1), (2, 2, 2))
    kept.put("zones", [made("inRoom", room, about="hall")], NOW)
    kept.put("people", [made("containsPerson", (BALL, 4), kind="int32", legend={4: "anna"})], NOW)
    return kept


@pytest.fixture
def catalogue(maps: MapBuffer) -> FieldCatalogue:
    regions = RegionMap(SIZE)
    regions.insert(7, OTHER)
    occupancy = NamedRegionMap(regions, {7: "mug1"})
    return FieldCatalogue(
        VOCABULARY, maps, NAMES, occupancy=occupancy, voxel_size=SIZE, farthest=0.4
    )


def stated(catalogue: FieldCatalogue, name: str, **limits: Any) -> set[tuple[Any, ...]]:
    return rows(catalogue.relation(VOCABULARY[name]).statements(Demand(**limits)))


def test_keys_of_voxels_keep_their_order() -> None:
    voxels = np.random.default_rng(1).integers(-(2**20), 2**20, (1000, 3)).astype(np.int32)
    np.testing.assert_array_equal(voxels_of_keys(keys_of(voxels)), voxels)
    order = np.lexsort(voxels.T[::-1])
    assert (np.diff(keys_of(voxels[order])) > 0).all()
    with pytest.raises(ValueError, match="from the origin"):
        keys_of(np.array([[2**20, 0, 0]], np.int32))


def test_the_statements_of_maps(catalogue: FieldCatalogue) -> None:
    ball, other = cells(BALL), cells(OTHER)
    human, anna = {(v, "human1") for v in ball}, {(v, "anna") for v in other}
    assert stated(catalogue, "inFieldOfView") == human | anna
    assert stated(catalogue, "inFieldOfView", objects={"anna"}) == anna
    seen = {(v, "mug") for v in ball - other} | {(v, "teddy") for v in other}
    assert stated(catalogue, "containsObject") == seen
    assert stated(catalogue, "containsObject", objects={"teddy"}) == {
        row for row in seen if row[1] == "teddy"
    }
    assert stated(catalogue, "attention") == {(v, 0.25) for v in other}
    assert stated(catalogue, "occupiedBy") == {(v, "mug1") for v in other}
    room = cells(Box((0, 0, 1), (2, 2, 2)))
    assert stated(catalogue, "freeIn") == {(v, "hall") for v in room - other}


def test_within_limits_the_statements_to_a_box(catalogue: FieldCatalogue) -> None:
    """All statements in the box are returned, and none far away."""
    wanted = np.sort(keys_of(voxels_of(Sphere((0.1, 0, 1.1), 0.1), SIZE)))
    for name in ("inFieldOfView", "containsObject", "inRoom", "freeIn", "distanceToPerson"):
        whole, part = stated(catalogue, name), stated(catalogue, name, within=wanted)
        inside = {tuple(v) for v in voxels_of_keys(wanted).tolist()}
        assert {r for r in whole if r[0] in inside} == {r for r in part if r[0] in inside}
        assert part < whole
    assert stated(catalogue, "inRoom", within=np.zeros(0, np.int64)) == set()


def test_distances_to_people(catalogue: FieldCatalogue) -> None:
    ball = np.array(sorted(cells(BALL)))
    for voxel, far in list(stated(catalogue, "distanceToPerson"))[::97]:
        nearest = np.linalg.norm((ball - voxel) * SIZE, axis=1).min()
        assert far == pytest.approx(nearest, abs=1e-4)
        assert far <= 0.4 + 1e-9


def test_types_include_supertypes(catalogue: FieldCatalogue) -> None:
    relation = catalogue.relation(RDF_TYPE)
    found = rows(relation.statements())
    assert {("mug1", "mug"), ("mug1", "drinkware"), ("mug1", "object"), ("anna", "agent")} <= found
    drinkware = {("mug1", "drinkware"), ("teacup", "drinkware")}
    assert rows(relation.statements(Demand(objects={"drinkware"}))) == drinkware
    assert rows(relation.statements(Demand({"anna"}, {"mug"}))) == set()


@pytest.mark.parametrize(
    ("name", "range_", "found"),
    [
        ("mug1", "object", {"mug1"}),
        ("human1", "agent", {"human1"}),
        ("Mug", None, {"mug", "mug1"}),
        ("coffee mug", "object", {"mug", "mug1"}),
        ("teddy", "object", {"teddy"}),
        ("person", "agent", {"person", "anna"}),
        ("kitchenware", "object", {"mug", "mug1", "teacup"}),
    ],
)
def test_constants_stand_for_entities_and_types(
    catalogue: FieldCatalogue, name: str, range_: str | None, found: set[str]
) -> None:
    assert catalogue.find_entities(name, range_) >= found


@pytest.mark.parametrize(
    ("name", "range_", "error", "says"),
    [
        ("mug", "agent", TypeError, "mug is not of the type agent"),
        ("mug1", "agent", TypeError, "mug1 is not of the type agent"),
        ("human", "agent", LookupError, "did you mean human1"),
    ],
)
def test_wrong_constants_are_refused(
    catalogue: FieldCatalogue, name: str, range_: str, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        catalogue.find_entities(name, range_)


def test_wrong_properties_are_refused(catalogue: FieldCatalogue) -> None:
    with pytest.raises(LookupError, match="no property inFieldOfVeiw; did you mean inFieldOfView"):
        catalogue.find_property("http://kb.openrobots.org/inFieldOfVeiw")
    with pytest.raises(LookupError, match="only the present of occupiedBy is known"):
        catalogue.during(NOW, NOW).find_property(VOCABULARY["occupiedBy"].iri)
    assert len(list(catalogue.properties())) == len(VOCABULARY.properties) + 1


def test_the_past_of_a_catalogue(catalogue: FieldCatalogue, maps: MapBuffer) -> None:
    maps.put("gaze", [], NOW + timedelta(seconds=10))
    assert stated(catalogue, "inFieldOfView") == set()
    moment = NOW + timedelta(seconds=5)
    then = catalogue.during(moment, moment)
    assert {row[1] for row in stated(then, "inFieldOfView")} == {"human1", "anna"}
    span = catalogue.during(NOW + timedelta(seconds=9), NOW + timedelta(seconds=20))
    assert {row[1] for row in stated(span, "inFieldOfView")} == {"human1", "anna"}
    after = catalogue.during(NOW + timedelta(seconds=10), NOW + timedelta(seconds=20))
    assert stated(after, "inFieldOfView") == set()


def store(catalogue: FieldCatalogue, text: str) -> RepresentationMap:
    answer = query(catalogue, PREFIX + text)
    assert isinstance(answer, StoreResult)
    return answer.to_map(NOW)


def test_store_makes_a_map(catalogue: FieldCatalogue, maps: MapBuffer) -> None:
    """A map with a legend, a map about an entity, and a map of numbers."""
    ball, other = cells(BALL), cells(OTHER)
    text = "SELECT ?v WHERE { ?v :inFieldOfView :human1 . ?v :containsObject ?o } STORE "
    both = store(catalogue, text + ":containsObject")
    found = {
        tuple(v): both.legend[n]
        for v, n in zip(both.voxels().tolist(), both.values().tolist(), strict=True)
    }
    assert found == {v: "teddy" if v in other else "mug" for v in ball}
    one = store(catalogue, "SELECT ?v WHERE { ?v :containsObject 'mug' } STORE :containsObject")
    assert (one.value_type, one.about) == ("bool", "mug")
    assert {tuple(v) for v in one.voxels().tolist()} == ball - other
    near = store(
        catalogue,
        "SELECT ?v WHERE { ?v :containsObject 'mug' . ?v :distanceToPerson ?d FILTER(?d < 0.2) } "
        "STORE :distanceToPerson",
    )
    assert near.value_type == "float32"
    maps.put("asked", [one], NOW)
    again = stated(catalogue, "containsObject", objects={"mug"})
    assert {row[0] for row in again} == ball - other
    empty = store(
        catalogue,
        "SELECT ?v WHERE { ?v :containsObject ?o FILTER(:z(?v) > 50) } STORE :containsObject",
    )
    assert len(empty) == 0


def test_the_largest_number_of_several_maps_counts(
    catalogue: FieldCatalogue, maps: MapBuffer
) -> None:
    graded = made("inFieldOfView", (BALL, 0.75), kind="float32", about="bea")
    maps.put("more", [graded], NOW)
    ball, other = cells(BALL), cells(OTHER)
    assert stated(catalogue, "attention") == {
        (v, 0.75 if v in ball else 0.25) for v in ball | other
    }
    assert isinstance(catalogue.relation(VOCABULARY["attention"]).statements().object, Numbers)
