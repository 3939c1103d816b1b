"""A processor by others makes the facts of the map from its mapping as R2RML."""

from __future__ import annotations

from pathlib import Path

import psycopg
import pytest
import rdflib
from rdflib.namespace import Namespace

import semmap
from semmap import Map
from semmap.knowledge.mapping import COMPUTED, REWRITTEN, TRIPLES
from semmap.knowledge.r2rml import RR
from tests.command_line import semmap as semmap_command
from tests.conftest import MakeDatabase
from tests.oracles.r2rml import facts_of, materialized, needs_processor

TERM = Namespace(RR)

ODD = r"""
PREFIX ex: <http://example.org/>
INSERT DATA {
    :cup ex:says "a \"quote\"\nand \\ it's {x} %s"@de-AT, "5"^^<http://example.org/100%25'> ;
        ex:like ex:tea ; rel:beside :shelf .
    ex:like rdfs:subPropertyOf ex:knows . rel:beside a owl:SymmetricProperty .
    GRAPH ex:in_100%25 { ex:tea ex:from "Ceylon", 1.50, true }
}
"""


@needs_processor
def test_the_document_makes_the_facts_of_the_map(loft_map: Map, tmp_path: Path) -> None:
    expected = facts_of(loft_map)
    assert len({quad.graph_name for quad in expected}) == 3
    loft_map.export_r2rml(tmp_path / "loft.ttl")
    assert materialized(tmp_path / "loft.ttl", loft_map.engine.url) == expected


@needs_processor
def test_odd_names_and_inferences(make_database: MakeDatabase, tmp_path: Path) -> None:
    url = make_database()
    with semmap.connect(url.render_as_string(hide_password=False)) as db:
        made = db.create_map("Haus 5 {n}, 100 %")
        for name in ("cup", "shelf"):
            odd = {"it's": f"\\ {name}", "": None}
            made.add_object(name, type=f"my {name}", properties=odd, define=True)
        made.knowledge_client().add(["cup rel:on shelf"], model="no IRI {1} 'x'")
        made.update(ODD)
        with pytest.raises(ValueError, match="nothing is inferred"):
            made.export_r2rml(tmp_path / "house.ttl", inferences=True)
        assert not (tmp_path / "house.ttl").exists()
        assert made.reason().inferences > 1
        expected = facts_of(made, inferences=True)
        count = made.export_r2rml(tmp_path / "house.ttl", inferences=True)
        document = rdflib.Graph().parse(tmp_path / "house.ttl")
        assert len([*document[: rdflib.RDF.type : TERM.TriplesMap]]) == count
    assert materialized(tmp_path / "house.ttl", url) == expected
    assert len({quad.graph_name for quad in expected}) == 4


def test_all_rows_of_the_mapping_have_their_columns(loft_map: Map) -> None:
    """Those of manipulation, of which the loft has none, too."""
    text = loft_map.r2rml()
    document = rdflib.Graph().parse(data=text)
    predicates = {str(each) for each in document.objects(None, TERM.predicate)}
    assert {t.property for t in TRIPLES if t.name is None} <= predicates
    others = {each.property for each in COMPUTED} | {each.property for each in REWRITTEN}
    assert not others & predicates
    comments = " ".join(line for line in text.splitlines() if line.startswith("#"))
    for iri in others:
        assert f":{iri.rsplit('#')[-1]}" in comments
    for one in document[: rdflib.RDF.type : TERM.TriplesMap]:
        query = document.value(document.value(one, TERM.logicalTable), TERM.sqlQuery)
        assert "%" not in str(query)
        found = loft_map.connection.execute(f"SELECT * FROM ({query}) q LIMIT 0".encode())
        columns = [column.name for column in found.description]
        assert len(set(columns)) == len(columns)
        assert {column.type_code for column in found.description} == {
            psycopg.adapters.types["text"].oid
        }
        used = {str(each) for each in columns_of(document, one)}
        assert used == set(columns)


def columns_of(document: rdflib.Graph, node: rdflib.term.Node) -> set[rdflib.term.Node]:
    """Return the columns that a triples map names."""
    path = (TERM.subjectMap | TERM.predicateObjectMap) / (
        (TERM.predicateMap | TERM.objectMap) * "?"
    )
    return {c for each in document.objects(node, path) for c in document[each : TERM.column]}


def test_the_command(loft_map: Map, tmp_path: Path) -> None:
    url = loft_map.engine.url.render_as_string(hide_password=False)
    words = ("rdf", "mapping", "--map", "loft")
    text = semmap_command(url, *words).stdout
    assert text == loft_map.r2rml()
    done = semmap_command(url, *words[:2], str(tmp_path / "loft.ttl"), *words[2:])
    assert done.stdout.startswith(f"{text.count('rr:logicalTable')} triples maps -> ")
    assert (tmp_path / "loft.ttl").read_text() == text
