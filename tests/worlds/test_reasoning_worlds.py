"""Reasoning and shapes on the small house and the hotel, by the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from sqlalchemy import Engine

from semmap.ingest.importer import import_file
from semmap.language.error import QueryError
from tests.command_line import semmap

ROOMS = Path(__file__).parent / "small_house_rooms.geojson"
ONTOLOGY = """
@prefix : <http://example.org/care#> . @prefix semmap: <urn:semmap:ontology#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
semmap:Tableware rdfs:subClassOf :Fragile . :Fragile owl:disjointWith :Unbreakable .
:Careful a owl:Restriction ; owl:onProperty semmap:holds ; owl:someValuesFrom :Fragile .
:Careful rdfs:subClassOf :SlowZone .
"""
SHAPE = """
@prefix sh: <http://www.w3.org/ns/shacl#> . @prefix semmap: <urn:semmap:ontology#> .
@prefix prop: <urn:semmap:property#> .
<urn:shapes:Table> a sh:NodeShape ; sh:targetClass semmap:Table ; sh:property <urn:shapes:Mass> .
<urn:shapes:Mass> sh:path prop:mass ; sh:maxInclusive 500 ; sh:message "is too heavy to move" .
"""
CARE = "http://example.org/care#"


@pytest.fixture(scope="module")
def url(module_engine: Engine, worlds: Path) -> str:
    import_file(module_engine, worlds / "small_house/worlds/small_house.world", map_name="house")
    import_file(module_engine, ROOMS, map_name="house")
    import_file(module_engine, worlds / "rmf/hotel/hotel.building.yaml", map_name="hotel")
    return module_engine.url.render_as_string(hide_password=False)


def test_an_ontology_of_care_in_the_house(url: str, tmp_path: Path) -> None:
    path = tmp_path / "care.ttl"
    path.write_text(ONTOLOGY)
    semmap(url, "rdf", "import", path, "--map", "house")
    done = json.loads(semmap(url, "knowledge", "reason", "--map", "house", "--json").stdout)
    assert done["complete"]
    assert done["contradictions"] == 0
    text = f"SELECT ?x {{ ?x a <{CARE}SlowZone> }}"
    found = semmap(url, "sparql", text, "--map", "house").stdout
    assert ":KitchenTable_01_001" in found
    assert ":Bed_01_001" not in found
    assert ":Kitchen" not in semmap(url, "sparql", text, "--map", "house", "--told").stdout
    proof = semmap(
        url, "knowledge", "why", f":KitchenTable_01_001 a <{CARE}SlowZone>", "--map", "house"
    )
    assert ":KitchenTable_01_001 semmap:holds :Tableware_01_001" in proof.stdout
    # The tableware is carried to the bedroom's floor: the table is no slow zone any more.
    moved = (
        "SELECT move_to(entity_id('Tableware_01_001'), ST_X(p), ST_Y(p), 0) FROM (SELECT "
        "ST_PointOnSurface(footprint) AS p FROM world WHERE entity_id = entity_id('bedroom')) w"
    )
    semmap(url, "sql", "--write", moved, "--map", "house")
    done = json.loads(semmap(url, "knowledge", "reason", "--map", "house", "--json").stdout)
    assert not done["complete"]
    assert done["removed"] == 2
    found = semmap(url, "sparql", text, "--map", "house").stdout
    assert ":KitchenTable_01_001" not in found
    clash = f"INSERT DATA {{ :Tableware_01_001 a <{CARE}Unbreakable> }}"
    semmap(url, "sparql", "--update", clash, "--map", "house")
    result = semmap(url, "knowledge", "contradictions", "--map", "house")
    assert result.exit_code == 1
    assert "are disjoint" in result.stdout
    assert ":Tableware_01_001 a semmap:Tableware" in result.stdout
    semmap(url, "knowledge", "reason", "--off", "--map", "house")
    with pytest.raises(LookupError, match="semmap knowledge reason"):
        semmap(url, "knowledge", "contradictions", "--map", "house")


@pytest.mark.parametrize(("name", "doors"), [("house", {":front-door"}), ("hotel", None)])
def test_the_worlds_have_what_a_robot_needs(url: str, name: str, doors: set[str] | None) -> None:
    result = semmap(url, "knowledge", "validate", "--map", name, "--json")
    found = json.loads(result.stdout)
    assert result.exit_code == 0, [each for each in found if each["severity"] == "violation"]
    if doors is not None:
        assert {each["name"] for each in found} == doors
    else:
        without_geometry = [each for each in found if each["path"] == "geo:hasBoundingBox"]
        assert len(without_geometry) == 175  # the import says so, too


def test_a_shape_binds_updates_of_the_hotel(url: str, tmp_path: Path) -> None:
    path = tmp_path / "weights.ttl"
    path.write_text(SHAPE)
    semmap(url, "knowledge", "bind", path, "--map", "hotel")
    name = json.loads(
        semmap(
            url, "sparql", "SELECT ?x { ?x a semmap:Table } LIMIT 1", "--map", "hotel", "--json"
        ).stdout
    )["results"]["bindings"][0]["x"]["value"]
    text = "INSERT DATA {{ <{}> prop:mass {} }}"
    with pytest.raises(QueryError, match=r"breaks the shapes weights.*too heavy to move"):
        semmap(url, "sparql", "--update", text.format(name, 900), "--map", "hotel")
    semmap(url, "sparql", "--update", text.format(name, 90), "--map", "hotel")
    assert (
        "none" in semmap(url, "knowledge", "bind", "--remove", "weights", "--map", "hotel").stdout
    )
