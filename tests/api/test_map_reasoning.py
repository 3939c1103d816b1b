"""Inferences, their explanation, and shapes, through a map."""

from __future__ import annotations

import queue
import threading
from pathlib import Path

import pytest

import semmap
from semmap.language.error import QueryError

AXIOMS = """INSERT DATA {
    semmap:Drinkware rdfs:subClassOf oro:Fragile . oro:Fragile rdfs:subClassOf oro:Precious .
    rel:beside a owl:SymmetricProperty . :cup1 rel:beside :table1 }"""

SHAPE = """@prefix sh: <http://www.w3.org/ns/shacl#> .
@prefix s: <urn:semmap:ontology#> . @prefix p: <urn:semmap:property#> .
<urn:x:Shape> a sh:NodeShape ; sh:targetClass s:Cup ;
    sh:property [ sh:path p:colour ; sh:minCount 1 ; sh:message "a cup has a colour" ] ."""


@pytest.fixture
def flat(db: semmap.Database) -> semmap.Map:
    made = db.create_map("flat")
    made.add_room("kitchen", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.6)
    made.add_object("table1", type="table", size=(1, 1, 0.7), in_="kitchen")
    made.add_object("cup1", type="cup", size=(0.1, 0.1, 0.1), on="table1")
    return made


def test_inferences_are_seen_explained_and_forgotten(flat: semmap.Map, tmp_path: Path) -> None:
    flat.update(AXIOMS)
    told = len(flat.graph())
    fragile, beside = "SELECT ?x { ?x a oro:Precious }", "ASK { :table1 rel:beside :cup1 }"
    assert not flat.sparql(fragile)
    done = flat.reason()
    assert done.complete
    assert done.added == done.inferences > 2
    assert list(flat.sparql(fragile)) == [("cup1",)]
    assert flat.sparql(beside)
    assert not flat.sparql(beside, inferred=False)
    proof = flat.why(":cup1 a oro:Precious")
    assert "oro:Precious" in proof.axiom
    assert flat.why(":cup1 rel:beside :table1").axiom == ""
    with pytest.raises(LookupError, match=":table1 a oro:Precious is not a fact"):
        flat.why(":table1 a oro:Precious")
    assert len(flat.graph()) == told
    both = flat.graph(inferences=True)
    assert len(both) == told + done.inferences
    flat.export_rdf(tmp_path / "all.nt", inferences=True)
    lines = (tmp_path / "all.nt").read_text().splitlines()
    assert len([line for line in lines if line]) == told + done.inferences
    assert flat.reason().complete is False
    assert flat.contradictions() == []
    flat.forget_inferences()
    assert not flat.sparql(fragile)


def test_a_contradiction_is_listed_with_what_it_follows_from(flat: semmap.Map) -> None:
    flat.update("INSERT DATA { semmap:Cup owl:disjointWith <urn:x:Toy> . :cup1 a <urn:x:Toy> }")
    assert flat.reason().contradictions == 1
    (found,) = flat.contradictions()
    assert ":cup1" in found.fact
    assert len(found.because) == 2


def test_changes_are_followed_by_the_reasoner(flat: semmap.Map) -> None:
    flat.update(AXIOMS)
    runs: queue.SimpleQueue[int] = queue.SimpleQueue()
    stop = threading.Event()
    follower = threading.Thread(
        target=flat.keep_reasoning,
        args=(lambda done: runs.put(done.added),),
        kwargs={"stop": stop},
    )
    follower.start()
    try:
        assert runs.get(timeout=20) > 0
        with semmap.connect(flat.database.address) as other:
            again = other.map("flat")
            again.add_object("cup2", type="cup", size=(0.1, 0.1, 0.1), on="table1")
            assert runs.get(timeout=20) > 0
            assert {row[0] for row in again.sparql("SELECT ?x { ?x a oro:Precious }")} == {
                "cup1",
                "cup2",
            }
    finally:
        stop.set()
        follower.join()
    flat.keep_reasoning(seconds=0.1)


def test_shapes_are_validated_and_bind(flat: semmap.Map, tmp_path: Path) -> None:
    path = tmp_path / "colours.ttl"
    path.write_text(SHAPE)
    (found,) = flat.validate(path)
    assert (found.name, found.severity, found.message) == (
        ":cup1",
        "violation",
        "a cup has a colour",
    )
    assert {each.severity for each in flat.validate()} <= {"violation", "warning", "info"}
    with pytest.raises(ValueError, match="does not conform"):
        flat.bind_shapes(path)
    flat.update("INSERT DATA { :cup1 prop:colour 'red' }")
    assert flat.validate([path]) == []
    flat.bind_shapes(str(path))
    assert flat.binding_shapes == ["colours"]
    with pytest.raises(QueryError, match="breaks the shapes colours"):
        flat.update("DELETE DATA { :cup1 prop:colour 'red' }")
    with pytest.raises(LookupError, match=r"no shapes colors bind the map flat.*colours"):
        flat.unbind_shapes("colors")
    flat.unbind_shapes("colours")
    assert flat.binding_shapes == []
    flat.update("DELETE DATA { :cup1 prop:colour 'red' }")
    with pytest.raises(semmap.WorldError, match="cannot be read"):
        flat.validate(tmp_path / "none.ttl")
