from collections.abc import Callable
from pathlib import Path
from typing import Any

import networkx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rdflib import DCTERMS, Graph
from sqlalchemy import Engine

from semmap.ingest import naming
from semmap.ingest.annotation import feature_values
from semmap.ingest.naming import TYPE_WORDS
from semmap.ingest.ontology import tbox
from semmap.ingest.ontology.tbox import (
    KINDS,
    TYPICAL_SIZE,
    TypeRecord,
    ontology_files,
    own_tbox,
    read_tbox,
)
from semmap.ingest.ontology.type_store import load_tbox
from semmap.ingest.world import WorldError
from semmap.query.geometry_notes import names_note
from semmap.snake_case import local_name, snake_case

ONTOLOGY = sorted(Path(__file__).parents[3].joinpath("schema/ontology").glob("*.ttl"))

HEAD = """@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix skos: <http://www.w3.org/2004/02/skos/core#> .
@prefix : <urn:example:t#> .
"""

COCO = """person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light,
fire hydrant, stop sign, parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear,
zebra, giraffe, backpack, umbrella, handbag, tie, suitcase, frisbee, skis, snowboard, sports ball,
kite, baseball bat, baseball glove, skateboard, surfboard, tennis racket, bottle, wine glass, cup,
fork, knife, spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot, hot dog, pizza, donut,
cake, chair, couch, potted plant, bed, dining table, toilet, tv, laptop, mouse, remote, keyboard,
cell phone, microwave, oven, toaster, sink, refrigerator, book, clock, vase, scissors, teddy bear,
hair drier, toothbrush"""

SUBSUMED = [
    ("desk", "table"),
    ("dining_table", "furniture"),
    ("kitchen_table", "object"),
    ("muffin", "food"),
    ("mug", "drinkware"),
    ("bookshelf", "shelf"),
    ("couch", "sofa"),
    ("kitchen", "room"),
    ("elevator_cabin", "room"),
    ("patient_room", "bedroom"),
    ("elevator_door", "connector"),
    ("stairs", "connector"),
    ("home_region", "region"),
    ("keepout_zone", "blocked_region"),
    ("support_surface", "region"),
    ("robot", "agent"),
    ("storey", "entity"),
]


@pytest.fixture(scope="module")
def records() -> dict[str, TypeRecord]:
    return {r.name: r for r in read_tbox(ONTOLOGY)}


@pytest.fixture
def turtle(tmp_path: Path) -> Callable[..., Path]:
    def write(text: str, name: str = "t.ttl") -> Path:
        path = tmp_path / name
        path.write_text(HEAD + text, encoding="utf-8")
        return path

    return write


def hierarchy(records: dict[str, TypeRecord]) -> networkx.DiGraph:
    graph = networkx.DiGraph()
    graph.add_nodes_from(records)
    graph.add_edges_from((r.name, parent) for r in records.values() for parent in r.parents)
    return graph


# The ontology itself


@pytest.mark.parametrize(("sub", "super_"), SUBSUMED)
def test_subsumption(records: dict[str, TypeRecord], sub: str, super_: str) -> None:
    assert super_ in networkx.descendants(hierarchy(records), sub)


def test_every_type_is_below_one_kind_of_entity(records: dict[str, TypeRecord]) -> None:
    graph = hierarchy(records)
    for name in records.keys() - {"entity"}:
        above = networkx.descendants(graph, name) | {name}
        assert above & set(KINDS) == {records[name].kind}
        assert "entity" in above
    assert records["entity"].kind is None


def test_all_coco_labels_are_types(records: dict[str, TypeRecord]) -> None:
    labels = [" ".join(label.split()) for label in COCO.split(",")]
    assert len(labels) == 80
    assert [label for label in labels if label.replace(" ", "_") not in records] == []


def test_types_that_names_suggest_are_there(records: dict[str, TypeRecord]) -> None:
    assert sorted(TYPE_WORDS.keys() - records.keys()) == []


def test_every_type_has_label_and_comment(records: dict[str, TypeRecord]) -> None:
    assert [r.name for r in records.values() if not r.comment or not r.label] == []


def test_labels_and_synonyms_mean_one_type(records: dict[str, TypeRecord]) -> None:
    meant: dict[str, set[str]] = {}
    for record in records.values():
        for word in (record.label, *record.synonyms):
            meant.setdefault(word.lower(), set()).add(record.name)
    twice = {word: types for word, types in meant.items() if len(types) > 1}
    assert all(word.replace(" ", "_") in types for word, types in twice.items()), twice


# The reader


def test_a_record_has_the_values_of_the_file(turtle: Callable[..., Path]) -> None:
    path = turtle(
        ":Object a owl:Class . :Table a owl:Class ; rdfs:subClassOf :Object ."
        ":Storage a owl:Class ; rdfs:subClassOf :Object ."
        ":TVTable a rdfs:Class ; rdfs:subClassOf :Table, :Storage ;"
        ' rdfs:label "Fernsehtisch"@de, "TV table"@en ; skos:altLabel "TV stand" ;'
        ' rdfs:comment "Carries a television." .'
    )
    assert read_tbox([path])[-1] == TypeRecord(
        name="tv_table",
        label="TV table",
        iri="urn:example:t#TVTable",
        parents=("storage", "table"),
        kind="object",
        comment="Carries a television.",
        synonyms=("TV stand",),
    )


def test_a_size_may_be_in_another_file(turtle: Callable[..., Path], tmp_path: Path) -> None:
    types = turtle(":Object a owl:Class . :Bed a owl:Class ; rdfs:subClassOf :Object .")
    sizes = tmp_path / "sizes.ttl"
    sizes.write_text(
        "@prefix owl: <http://www.w3.org/2002/07/owl#> . @prefix : <urn:example:t#> ."
        ':Bed a owl:Class ; <urn:semmap:ontology#typicalSize> "2.1 1.6 0.6" .'
    )
    found = {record.name: record.typical_size for record in read_tbox([sizes, types])}
    assert found == {"object": None, "bed": (2.1, 1.6, 0.6)}


def test_usual_places_are_read(tmp_path: Path) -> None:
    path = tmp_path / "t.ttl"
    head = "@prefix : <urn:semmap:ontology#> . @prefix owl: <http://www.w3.org/2002/07/owl#> . "
    path.write_text(head + ":Kitchen a owl:Class . :Food a owl:Class ; :foundIn :Kitchen .")
    assert {r.name: r.found_in for r in read_tbox([path])} == {"kitchen": (), "food": ("kitchen",)}
    path.write_text(head + ":Food a owl:Class ; :foundIn :Kichen .")
    with pytest.raises(WorldError, match=r"found in <.*Kichen>, which is declared in none"):
        read_tbox([path])


def test_common_furniture_has_a_typical_size(records: dict[str, TypeRecord]) -> None:
    sizes = {name: r.typical_size for name, r in records.items() if r.typical_size is not None}
    assert {"bed", "table", "chair", "sofa", "toilet", "refrigerator"} <= {*sizes}
    assert all(0.05 <= length <= 7 for size in sizes.values() for length in size)
    assert {records[name].kind for name in sizes} == {"object"}


def test_each_typical_size_states_its_source() -> None:
    """Its own, else that of all, as rdflib reads the file; what lists assumed sizes says so."""
    graph = Graph().parse(next(path for path in ONTOLOGY if path.name == "sizes.ttl"))
    of_all = [str(given) for given in graph.objects(TYPICAL_SIZE, DCTERMS.source)]
    sources = {
        snake_case(local_name(str(type_))): [*map(str, graph.objects(type_, DCTERMS.source))]
        for type_ in graph.subjects(TYPICAL_SIZE)
    }
    assert {r.name for r in own_tbox() if r.typical_size is not None} == {*sources}
    assert all(len(own or of_all) == 1 for own in sources.values())
    assert of_all[0].startswith("own estimate")
    others = {name for name, own in sources.items() if "own estimate" not in (own or of_all)[0]}
    assert others == {"car"}  # of a person, the height alone is from a standard
    note = names_note(["desk1"], "assumed_sizes")
    assert "an own estimate unless sizes.ttl states another source: desk1" in note


def test_without_a_label_the_name_is_the_label(turtle: Callable[..., Path]) -> None:
    (record,) = read_tbox([turtle(":DiningTable a owl:Class .")])
    assert (record.label, record.comment, record.kind) == ("dining table", None, None)


def test_a_type_of_two_kinds_has_no_kind(turtle: Callable[..., Path]) -> None:
    path = turtle(
        ":Object a owl:Class . :Region a owl:Class ."
        ":Dock a owl:Class ; rdfs:subClassOf :Object, :Region ."
    )
    assert {r.name: r.kind for r in read_tbox([path])}["dock"] is None


def test_files_refer_to_each_other(turtle: Callable[..., Path]) -> None:
    low = turtle(":Desk a owl:Class ; rdfs:subClassOf :Table .", "low.ttl")
    high = turtle(
        ":Table a owl:Class . :Desk a owl:Class ; rdfs:comment 'To work at.' .", "high.ttl"
    )
    assert [(r.name, r.parents, r.comment) for r in read_tbox([low, high])] == [
        ("table", (), None),
        ("desk", ("table",), "To work at."),
    ]


def test_n_triples(tmp_path: Path) -> None:
    path = tmp_path / "t.nt"
    path.write_text(
        "<urn:e#Mug> <http://www.w3.org/1999/02/22-rdf-syntax-ns#type> "
        "<http://www.w3.org/2002/07/owl#Class> .\n"
    )
    assert [r.name for r in read_tbox([path])] == ["mug"]


def test_foreign_superclasses_and_restrictions_are_left_out(turtle: Callable[..., Path]) -> None:
    path = turtle(
        ":Desk a owl:Class ; rdfs:subClassOf owl:Thing, <http://example.org/x#Table>,"
        " [ a owl:Restriction ; owl:onProperty :has ; owl:someValuesFrom :Top ] ."
    )
    assert [(r.name, r.parents) for r in read_tbox([path])] == [("desk", ())]


@given(st.data())
def test_parents_come_first(data: st.DataObject) -> None:
    size = data.draw(st.integers(1, 9))
    rank = data.draw(st.permutations(range(size)))
    edges = {
        (rank[i], rank[j])
        for i, j in data.draw(
            st.sets(st.tuples(st.integers(0, size - 1), st.integers(0, size - 1)))
        )
        if i > j
    }
    text = HEAD + "".join(f":C{i} a owl:Class . " for i in range(size))
    text += "".join(f":C{i} rdfs:subClassOf :C{j} . " for i, j in edges)
    seen: set[str] = set()
    for record in _read_text(text):
        assert set(record.parents) <= seen
        seen.add(record.name)
    assert seen == {f"c{i}" for i in range(size)}


def _read_text(text: str) -> list[TypeRecord]:
    import tempfile

    with tempfile.NamedTemporaryFile("w", suffix=".ttl") as file:
        file.write(text)
        file.flush()
        return read_tbox([Path(file.name)])


# Bad input


@pytest.mark.parametrize(
    ("text", "element", "problem"),
    [
        (
            ":A a owl:Class ; rdfs:subClassOf :B .\n:B a owl:Class ; rdfs:subClassOf :A .",
            "class",
            "itself",
        ),
        (":A a owl:Class ; rdfs:subClassOf :A .", "class a", "a > a"),
        (":A a owl:Class ;\n  rdfs:label 'a' rdfs:comment 'b' .", "line 6", "Turtle"),
        (":A a owl:Class ; rdfs:label 'cut off", "file", "Turtle"),
        (":A a nowhere:Class .", "line 5", "Turtle"),
        (":A a owl:Class ; rdfs:subClassOf :Tabel .", "#A", "#Tabel"),
        (
            ':A a owl:Class ; <urn:semmap:ontology#typicalSize> "1 2" .',
            "#A",
            "typical size is '1 2'",
        ),
        (
            ':A a owl:Class ; <urn:semmap:ontology#typicalSize> "1 2 -3" .',
            "#A",
            "typical size is '1 2 -3'",
        ),
        (":DiningTable a owl:Class . :dining_table a owl:Class .", "class", "dining_table"),
    ],
)
def test_an_ontology_that_cannot_be_trusted(
    turtle: Callable[..., Path], text: str, element: str, problem: str
) -> None:
    path = turtle(text)
    with pytest.raises(WorldError, match=r"t\.ttl") as caught:
        read_tbox([path])
    assert element in caught.value.element
    assert problem in caught.value.problem
    assert caught.value.fix


def test_files_that_are_not_ontologies(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="cannot be read"):
        read_tbox([tmp_path / "absent.ttl"])
    for name, content, problem in [
        ("a.owl", b"<rdf/>", "ending"),
        ("a.ttl", b"\xff\xfe\x00", "UTF-8"),
        ("a.nt", b"<a> <b>", "Turtle"),
    ]:
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(WorldError, match=problem):
            read_tbox([path])


@pytest.mark.parametrize(
    ("local", "name"),
    [
        ("DiningTable", "dining_table"),
        ("TV", "tv"),
        ("TVCabinet", "tv_cabinet"),
        ("Lab2", "lab2"),
        ("wall", "wall"),
        ("PieceOfFurniture-Large", "piece_of_furniture_large"),
    ],
)
def test_snake_case(local: str, name: str) -> None:
    assert snake_case(local) == name


def test_the_files_of_the_ontology_are_found() -> None:
    assert sorted(ontology_files()) == ONTOLOGY


def test_an_import_parses_each_file_once(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    """The store of types, guesses from names and words of annotations read the same classes."""
    parsed: list[Path] = []
    parse = tbox._parse

    def counted(path: Path) -> Any:
        parsed.append(path)
        return parse(path)

    monkeypatch.setattr(tbox, "_parse", counted)
    for cached in (own_tbox, naming._phrases, feature_values._tbox, feature_values._type_of_word):
        cached.cache_clear()
    with engine.connect() as connection:
        connection.exec_driver_sql("DELETE FROM ontology")
        assert load_tbox(connection) > 100
        connection.rollback()
    assert ("coffee", "table") in naming._phrases("object")
    assert "cup" in feature_values._type_of_word()
    assert parsed == ontology_files()
