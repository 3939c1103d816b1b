"""Updates change the tables that hold their facts, all of them or none."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

import psycopg
import pytest
import rdflib

from semmap import Map
from semmap.ingest.world import WorldError
from semmap.knowledge import KnowledgeError
from semmap.knowledge.queries import query
from semmap.knowledge.rdf_file import parse_facts, store_facts
from semmap.knowledge.updates import update
from semmap.knowledge.whole_graph import RDF_FORMATS, dump, serialized
from semmap.language.error import QueryError

EX = "PREFIX ex: <http://example.org/> "


def value(session: psycopg.Connection, sql: str) -> object:
    return session.execute(sql).fetchone()[0]


def truth(session: psycopg.Connection, pattern: str) -> bool:
    return query(session, f"{EX} ASK {{ {pattern} }}").truth


def test_facts_go_to_the_tables_that_have_columns_for_them(changing: psycopg.Connection) -> None:
    text = """INSERT DATA {
        :mug a semmap:Mug ; semmap:placedOn :table ; prop:colour "green" ; rel:beside :sofa ;
             rdfs:label "the good mug" ; ex:smells "of coffee" }"""
    assert update(changing, EX + text).added == 6
    row = changing.execute(
        "SELECT kind, type, label, properties, (SELECT relation FROM placement "
        "WHERE entity_id = entity.id), (SELECT count(*) FROM link WHERE from_id = entity.id), "
        "(SELECT count(*) FROM statement WHERE subject_id = entity.id) "
        "FROM entity WHERE name = 'mug'"
    ).fetchone()
    assert row == ("object", "mug", "the good mug", {"colour": "green"}, "on", 1, 1)
    assert update(changing, EX + text).added == 0
    gone = update(changing, "DELETE WHERE { :mug rel:beside ?y ; prop:colour ?c }")
    assert gone.removed == 2
    assert not truth(changing, ":mug rel:beside ?y")


def test_delete_and_insert_see_the_same_state(changing: psycopg.Connection) -> None:
    text = "DELETE { ?x prop:colour ?c } INSERT { ?x prop:paint ?c } WHERE { ?x prop:colour ?c }"
    changes = update(changing, text)
    assert (changes.added, changes.removed) == (3, 3)
    assert truth(changing, ':cup%201 prop:paint "blau" FILTER NOT EXISTS { ?y prop:colour ?c }')


def test_graphs_are_cleared_copied_and_moved(changing: psycopg.Connection) -> None:
    update(changing, EX + "COPY ex:archive TO ex:copy ; MOVE :ann_believes TO ex:moved")
    assert truth(changing, "GRAPH ex:copy { :bob ex:likes 'juice' }")
    assert truth(changing, "GRAPH ex:moved { :bob ex:likes 'milk' }")
    assert not truth(changing, "GRAPH :ann_believes { ?s ?p ?o }")
    assert update(changing, EX + "CLEAR GRAPH ex:copy").removed == 1
    assert (
        update(changing, EX + "WITH ex:moved DELETE { ?s ?p ?o } WHERE { ?s ?p ?o }").removed == 2
    )
    assert not truth(changing, "GRAPH ex:moved { ?s ?p ?o }")


def test_the_default_graph_gives_and_takes_facts(changing: psycopg.Connection) -> None:
    update(changing, EX + "ADD ex:archive TO DEFAULT ; ADD DEFAULT TO ex:all")
    assert truth(changing, ":bob ex:likes 'juice' GRAPH ex:all { :bob ex:likes 'juice' }")
    assert truth(changing, "GRAPH ex:all { :table semmap:name 'table' }")
    update(changing, EX + "CLEAR SILENT ALL ; LOAD SILENT <http://example.org/data>")
    assert truth(changing, "GRAPH ex:archive { :bob ex:likes 'juice' }")


def test_using_chooses_the_graphs_that_where_reads(changing: psycopg.Connection) -> None:
    text = """INSERT { GRAPH ex:new { ?s ex:liked ?o } } USING ex:archive
        USING NAMED :ann_believes WHERE { ?s ex:likes ?o GRAPH ?g { ?s ?p ?q } }"""
    changes = update(changing, EX + text)
    assert changes.added == 1
    assert truth(changing, "GRAPH ex:new { :bob ex:liked 'juice' }")
    text = "WITH ex:new DELETE { ?s ?p ?o } USING ex:archive WHERE { ?s ex:likes ?o . ?s ?p ?x }"
    assert update(changing, EX + text).removed == 0  # what it read is not in ex:new


def test_with_names_a_graph_that_may_be_empty(changing: psycopg.Connection) -> None:
    update(changing, EX + "WITH ex:new INSERT { :bob ex:likes 'tea' } WHERE {}")
    assert truth(changing, "GRAPH ex:new { :bob ex:likes 'tea' }")
    text = "INSERT { :bob ex:likes 'tea' } WHERE { GRAPH ex:nowhere {} }"
    assert update(changing, EX + text).added == 0


REFUSED = (
    ("INSERT DATA { :table semmap:x 3.0 }", "follows from"),
    ("INSERT DATA { :bob ex:new 1 . :table geo:sfContains :sofa }", "follows from"),
    ("INSERT DATA { <urn:semmap:map:other#nobody> a semmap:Person }", "urn:semmap:map:loft#"),
    ("INSERT DATA { :nobody rel:beside :table }", "not an entity"),
    ("INSERT DATA { :nobody geo:asWKT 'POINT(1 2)' }", "follows from"),
    ("INSERT DATA { semmap:Table bot:interfaceOf :studio }", "follows from"),
    ("INSERT DATA { ex:nobody a semmap:Tabel }", "neither a class"),
    ("INSERT DATA { ex:nobody semmap:on :table }", "would not be seen"),
    ("INSERT DATA { ex:nobody semmap:sees :table }", "would not be seen"),
    ("INSERT DATA { :studio semmap:placedIn :studio }", "itself"),
    ("INSERT DATA { :table a semmap:Kitchen }", "kind"),
    ('INSERT DATA { :table prop:when "2026-01-01T00:00:00Z"^^xsd:dateTime }', "JSON"),
    ("LOAD <http://example.org/data>", "not supported"),
    ("CLEAR ALL", "default graph"),
    ("MOVE ex:archive TO DEFAULT", "default graph"),
    ("MOVE DEFAULT TO ex:archive", "default graph"),
    ("INSERT DATA { :a :b }", "SPARQL"),
    ("DELETE WHERE { _:b ex:likes ?x }", "blank node"),
    ("INSERT { ?x ex:likes ?y } WHERE { ?x foaf:knows ?y BIND(1 AS ?y) }", "bound already"),
)


@pytest.mark.parametrize(("text", "reason"), REFUSED)
def test_an_update_is_refused_as_a_whole(
    changing: psycopg.Connection, text: str, reason: str
) -> None:
    counts = "SELECT (SELECT count(*) FROM statement), (SELECT count(*) FROM entity)"
    before = changing.execute(counts).fetchone()
    with pytest.raises(QueryError, match=reason) as caught:
        update(changing, f"{EX} INSERT DATA {{ :bob ex:first 1 }} ; {text}")
    assert caught.value.line == 1
    assert changing.execute(counts).fetchone() == before


def test_statements_go_with_their_entity_and_follow_a_new_one(
    changing: psycopg.Connection,
) -> None:
    update(changing, EX + "INSERT DATA { :later ex:size 3 . :bob ex:wants :later }")
    assert truth(changing, ":bob ex:wants ?x . ?x ex:size 3")
    update(changing, "INSERT DATA { :later a semmap:Box }")
    assert truth(changing, ":bob ex:wants ?x . ?x ex:size 3 ; a semmap:Box ; semmap:kind 'object'")
    changing.execute("DELETE FROM entity WHERE name = 'later'")
    assert not truth(changing, "?x ex:size 3")


def test_a_copy_does_not_lose_a_lifespan(changing: psycopg.Connection) -> None:
    changing.execute(
        "UPDATE statement SET until = now() + interval '1 h' WHERE graph LIKE '%archive'"
    )
    with pytest.raises(QueryError, match="lifespan"):
        update(changing, EX + "COPY ex:archive TO ex:copy")


def test_a_statement_with_an_end_is_gone_after_it(changing: psycopg.Connection) -> None:
    update(changing, EX + "INSERT DATA { :bob ex:hungry true }")
    changing.execute(
        "UPDATE statement SET until = now() - interval '1 s' WHERE object = 'true' "
        "AND predicate LIKE '%hungry'"
    )
    assert not truth(changing, ":bob ex:hungry ?h")


def test_changes_are_in_the_change_feed(changing: psycopg.Connection) -> None:
    before = value(changing, "SELECT coalesce(max(id), 0) FROM change")
    update(
        changing, EX + "INSERT DATA { :bob ex:seen :table } ; DELETE DATA { :bob ex:seen :table }"
    )
    rows = changing.execute(
        "SELECT what, entities FROM change WHERE id > %s ORDER BY id", (before,)
    ).fetchall()
    bob = value(changing, "SELECT entity_id('bob')")
    assert rows == [("statement", [bob]), ("statement", [bob])]


@pytest.mark.parametrize("format_", RDF_FORMATS)
def test_what_is_written_is_read_again_without_a_change(
    changing: psycopg.Connection, format_: str
) -> None:
    text = serialized(dump(changing), format_)
    facts = parse_facts(text, format_, Path("loft"))
    assert len(facts) > 500
    assert store_facts(changing, facts, Path("loft")) == 0


@pytest.mark.parametrize("name", ["no IRI", "noiri", "a<b>", "http://e/ a", "\\", 'ü"'])
def test_a_stored_graph_that_no_iri_names_is_written_and_dropped(
    changing: psycopg.Connection, name: str
) -> None:
    update(changing, EX + "INSERT DATA { GRAPH ex:g { :bob ex:saw 1 } GRAPH ex:h { :a ex:p 2 } }")
    changing.execute("UPDATE statement SET graph = %s WHERE graph = 'http://example.org/g'", [name])
    iri = rdflib.URIRef("urn:semmap:graph:" + quote(name, safe=""))
    for format_ in ("trig", "nquads", "json-ld"):
        facts = parse_facts(serialized(dump(changing), format_), format_, Path("loft"))
        (fact,) = (fact for fact in facts if str(fact.property).endswith("saw"))
        assert fact.graph == iri
    for wrong in (quote(name, safe="")[:-1], "", "http%3A%2F%2Fexample.org%2Fh"):
        assert update(changing, f"DROP SILENT GRAPH <urn:semmap:graph:{wrong}>").removed == 0
    assert update(changing, f"DROP GRAPH {iri.n3()}").removed == 1
    assert update(changing, EX + "DROP GRAPH ex:h").removed == 1


def _xml(declared: str, text: str) -> str:
    return (
        f"<!DOCTYPE r [ {declared} ]><r:RDF xmlns:r='http://www.w3.org/1999/02/22-rdf-syntax-ns#' "
        f"xmlns='http://e/'><r:Description r:about='http://e/x'><p>{text}</p></r:Description></r:RDF>"
    )


def test_xml_may_name_its_namespaces_by_entities(changing: psycopg.Connection) -> None:
    text = _xml('<!ENTITY name "http://e/"> <!ENTITY own "x#">', "&name;a &amp; &own;b &#65;")
    (fact,) = parse_facts(text, "xml", Path("a.owl"))
    assert str(fact.object) == "http://e/a & x#b A"
    assert store_facts(changing, [fact], Path("a.owl")) == 1


def test_files_of_strangers(changing: psycopg.Connection) -> None:
    text = "@prefix : <urn:semmap:map:loft#> . :bob <http://example.org/owns> [ :size 3 ] ."
    assert store_facts(changing, parse_facts(text, "turtle", Path("a.ttl")), Path("a.ttl")) == 2
    assert truth(changing, ":bob ex:owns ?x . ?x :size 3 FILTER(STRSTARTS(STR(?x), 'urn:semmap:'))")
    for wrong, format_ in (
        ("@prefix", "turtle"),
        ('{"@context": "http://a/b"}', "json-ld"),
        ("{", "json-ld"),
        ("<http://a/b> <http://a/c> <<( <http://a/d> <http://a/e> 1 )>> .", "turtle"),
        (_xml('<!ENTITY a "xyz"> <!ENTITY b "&a;&a;">', "&b;"), "xml"),
        (_xml('<!ENTITY b SYSTEM "file:///etc/passwd">', "&b;"), "xml"),
        (_xml(f'<!ENTITY b "{"long" * 5000}">', "&b;" * 5000), "xml"),
    ):
        with pytest.raises(WorldError):
            parse_facts(wrong, format_, Path("a"))


RELATIVE = (
    ("turtle", "<s> <p> <o>, '1'^^<d> ."),
    ("trig", "<g> { <s> <p> <o>, '1'^^<d> }"),
    ("json-ld", '{"@id": "g", "@graph": [{"@id": "s", "http://e/p": {"@id": "o"}}]}'),
)


@pytest.mark.parametrize(("format_", "text"), RELATIVE)
def test_relative_iris_of_a_file_are_resolved(format_: str, text: str) -> None:
    based = f"@base <http://f/> . {text}"
    if format_ == "json-ld":
        based = text.replace("{", '{"@context": {"@base": "http://f/"}, ', 1)
    for folder, each, base in (
        ("file:///tmp/", text, None),
        ("http://f/a/", text, "http://f/a/g"),
        ("http://f/", based, "http://e/"),
    ):
        facts = parse_facts(each, format_, Path("/tmp/a file"), base)
        assert {str(fact.subject) for fact in facts} == {f"{folder}s"}
        iris = {str(getattr(t, "datatype", None) or t) for f in facts for t in f if t is not None}
        assert all(iri.startswith((folder, "http://e/p")) for iri in iris)


@pytest.mark.parametrize("format_", ["nt", "nquads"])
def test_lines_have_no_relative_iris(format_: str) -> None:
    for line in ("<s> <e:p> <e:o> .", "<e:s> <p> <e:o> .", "<e:s> <e:p> '1'^^<d> ."):
        with pytest.raises(WorldError):
            parse_facts(line.replace("'", '"'), format_, Path("a"))


@pytest.mark.parametrize(
    "text",
    [
        "INSERT DATA { <s> <e:p> 1 }",
        "INSERT DATA { <e:s> <p> 1 }",
        "INSERT DATA { <e:s> <e:p> <o> }",
        "INSERT DATA { <e:s> <e:p> '1'^^<d> }",
        "INSERT DATA { GRAPH <g> { <e:s> <e:p> 1 } }",
        "INSERT { <e:s> <e:p> ?o } WHERE { BIND(STRDT('1', IRI('d')) AS ?o) }",
        "WITH <g> INSERT { <e:s> <e:p> 1 } WHERE {}",
    ],
)
def test_relative_iris_of_an_update_are_refused(changing: psycopg.Connection, text: str) -> None:
    with pytest.raises(QueryError, match="is not an absolute IRI"):
        update(changing, text)


def test_an_update_that_takes_too_long_changes_nothing(loft_map: Map) -> None:
    session = loft_map.connection
    text = "INSERT { ?a <http://example.org/all> ?c } WHERE { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
    with pytest.raises(KnowledgeError, match=r"0\.3 s"):
        update(session, text, seconds=0.3)
    assert not truth(session, "?x <http://example.org/all> ?y")


INJECTIONS = (
    "'; DROP TABLE entity; --",
    "%(p0)s %s %%",
    '\\"}; DELETE FROM entity',
    "\x27 OR 1=1",
    "{a}.name {0}",
    "$$;SELECT 1;$$",
    "\u2019\u0000".replace("\u0000", ""),
    "/* */ -- #",
)


@pytest.mark.parametrize("hostile", INJECTIONS)
def test_hostile_texts_are_values(changing: psycopg.Connection, hostile: str) -> None:

    literal = '"' + hostile.replace("\\", "\\\\").replace('"', '\\"') + '"'
    iri = f"<http://example.org/{quote(hostile, safe='')}>"
    escaped = '"' + "".join(f"\\u{ord(c):04X}" for c in hostile) + '"'
    count = value(changing, "SELECT count(*) FROM entity")
    new = f":bob {iri} {literal} ; prop:a%20b {literal} ; <http://example.org/e> {literal}"
    update(changing, f"INSERT DATA {{ {new} }} # {hostile}")
    for pattern in (
        f":bob {iri} {literal}",
        f":bob prop:a%20b {literal}",
        f":bob ?p {literal}",
        f":bob {iri} ?v FILTER(?v = {literal})",
        f":bob {iri} ?v FILTER(CONTAINS(?v, {literal}))",
        f"VALUES ?v {{ {literal} }} :bob {iri} ?v",
        f"GRAPH ?g {{ ?s ?p ?o }} FILTER(?g != {iri})",
        f":bob {iri} ?v BIND(CONCAT(?v, {literal}) AS ?w) FILTER(STRLEN(?w) = {2 * len(hostile)})",
    ):
        assert truth(changing, pattern), pattern
    if "\\" not in hostile and '"' not in hostile:
        assert truth(changing, f":bob {iri} {escaped}")
    assert value(changing, "SELECT count(*) FROM entity") == count
