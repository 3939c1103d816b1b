"""Data sets, labels and links in files."""

from __future__ import annotations

import pytest
import rdflib

from benchmarks.interlinking import read_folder
from semmap.interlinking.data_set_file import read_csv_records, read_rdf_records
from semmap.interlinking.link_file import (
    append_label,
    read_alignment,
    read_csv_labels,
    read_labels,
    same_as,
)
from semmap.interlinking.records import InterlinkingError, Records
from tests.interlinking.data_sets import alignment_xml, person1, rdf_xml


def test_a_folder_of_oaei(tmp_path, capsys) -> None:
    case = person1(n=30)
    (tmp_path / "p11.rdf").write_text(rdf_xml(case.left, "Person"))
    (tmp_path / "p12.rdf").write_text(rdf_xml(case.right, "Human"))
    (tmp_path / "gold.xml").write_text(alignment_xml(case.links))
    left, right, links = read_folder(tmp_path)
    assert links == case.links
    for read, made in ((left, case.left), (right, case.right)):
        assert set(read.keys) == set(made.keys)
        for key in made.keys:
            assert read.record(read.number[key]) == made.record(made.number[key])
    stranger = ("http://x", "http://y")
    (tmp_path / "gold.xml").write_text(alignment_xml({*case.links, stranger}))
    assert read_folder(tmp_path)[2] == case.links
    assert ": 1 links are of records that it lacks: dropped" in capsys.readouterr().out
    (tmp_path / "gold.xml").write_text(alignment_xml({stranger}))
    with pytest.raises(InterlinkingError, match="no pair is of records that both data sets have"):
        read_folder(tmp_path)
    (tmp_path / "gold.xml").unlink()
    with pytest.raises(InterlinkingError, match="2 data sets and 0 alignments"):
        read_folder(tmp_path)


def test_a_type_is_chosen(tmp_path) -> None:
    case = person1(n=5)
    path = tmp_path / "a.rdf"
    path.write_text(rdf_xml(case.left, "Person"))
    assert len(read_rdf_records(path, "Address")) == 5
    with pytest.raises(InterlinkingError, match=r"describes no Cup: its types are "):
        read_rdf_records(path, "Cup")


def test_resources_that_refer_to_each_other_end(tmp_path) -> None:
    path = tmp_path / "loop.ttl"
    path.write_text(
        "@prefix : <http://x/> . :a a :T; :p :b; :n 'one' . :b a :U; :q :a; :n 'two' . "
        ":c a :T; :p :c ."
    )
    read = read_rdf_records(path, "T")
    assert read.record(read.number["http://x/a"])["p/n"] == ("two",)
    assert read.record(read.number["http://x/c"])["p"] == ("c",)


def test_json_ld(tmp_path) -> None:
    path = tmp_path / "a.jsonld"
    path.write_text(
        '{"@context": {"p": "http://x/p"}, "@id": "http://x/a", "@type": "http://x/T", "p": "one"}'
    )
    read = read_rdf_records(path, "T")
    assert read.record(read.number["http://x/a"])["p"] == ("one",)


def test_csv(tmp_path) -> None:
    path = tmp_path / "a.csv"
    path.write_text('name,id,size\n"cup, red",1,\nbowl,2,0.2\n')
    read = read_csv_records(path)
    assert read.keys == ["1", "2"]
    assert read.record(0) == {"name": ("cup, red",)}
    assert read.record(1) == {"name": ("bowl",), "size": ("0.2",)}


def test_labels(tmp_path) -> None:
    path = tmp_path / "labels.csv"
    append_label(path, "a,1", "b", True)
    append_label(path, "c", "d", False)
    assert read_labels(path) == {("a,1", "b"): True, ("c", "d"): False}
    append_label(path, "c", "d", True)
    with pytest.raises(InterlinkingError, match="c and d are labelled yes and no equally often"):
        read_csv_labels(path)
    append_label(path, "c", "d", True)
    assert read_labels(path)["c", "d"] is True


def test_links_are_turtle() -> None:
    named = Records("folder/a set.csv", ["1>", "http://x/ü y"], {"p": [("v",), ("w",)]})
    text = same_as(named, named, [("1>", "http://x/ü y")])
    graph = rdflib.Graph().parse(data=text)
    assert {tuple(map(str, triple)) for triple in graph} == {
        ("urn:semmap:a%20set:1%3E", str(rdflib.OWL.sameAs), "http://x/%C3%BC%20y")
    }


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", b"", "is not a header"),
        ("a.csv", b"id,p,p\n1,2,3\n", "is not a header"),
        ("a.csv", b"id,p\n1\n", "row 2: has 1 cells, the header 2"),
        ("a.csv", b"id,p\n,1\n", "row 2: has no id"),
        ("a.csv", b"id,p\n1,2\n1,3\n", "the key '1' occurs twice"),
        ("a.csv", b"id,p\n1,\xff\n", "is not UTF-8"),
        ("a.csv", b"id,p\n", "has no records"),
        ("a.ttl", b"this is not turtle", "is not RDF in the format"),
        ("a.rdf", b"<rdf", "is not RDF in the format"),
        ("a.ttl", b"", "describes no resource"),
        ("a.jsonld", b'{"@context": "http://127.0.0.1:9/x", "p": 1}', "LoadDocumentCallback"),
        ("align.xml", b"<a/>", "has no <Cell>"),
        ("align.xml", b"<a><Cell><entity1/></Cell></a>", "cell 1: has the entities"),
        ("align.xml", b"<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>", "DOCTYPE"),
    ],
)
def test_bad_files_are_errors(tmp_path, name, content, message) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    read = {".csv": read_csv_records, ".xml": read_alignment}.get(path.suffix, read_rdf_records)
    with pytest.raises(InterlinkingError, match=message):
        read(path)


def test_an_absent_file_is_an_error(tmp_path) -> None:
    with pytest.raises(InterlinkingError, match="cannot be read"):
        read_csv_records(tmp_path / "absent.csv")
