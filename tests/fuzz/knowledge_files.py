"""Files of knowledge: point clouds, RDF, and records to interlink."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
import rdflib
import trimesh

from semmap.database.files import schema_folder
from semmap.interlinking.records import Records
from semmap.knowledge.whole_graph import without_warnings
from tests.belief.test_teaching import MAP_XML, lesson
from tests.fuzz.kind import Kind
from tests.fuzz.mutate import bytes_of, json_tree, lines_of, words_of, xml_tree
from tests.fuzz.server import loft, undone
from tests.fuzz.stored_knowledge import SECONDS
from tests.interlinking.data_sets import alignment_xml, person1, rdf_xml
from tests.knowledge.test_shacl import CUPS, HEAD


def tabletop() -> np.ndarray:
    """A table with a box and a ball on it, seen from above; metres in the optical frame."""
    random = np.random.default_rng(1)
    plane = np.column_stack([random.uniform(0, 1, (300, 2)), np.full(300, 0.7)])
    box = np.add(trimesh.creation.box((0.1, 0.1, 0.2)).sample(80, seed=1), (0.3, 0.3, 0.8))
    ball = np.add(trimesh.creation.icosphere(2, 0.06).sample(80, seed=1), (0.7, 0.6, 0.76))
    return np.concatenate([plane, box, ball]) * (1, 1, -1) + (-0.5, -0.5, 1.45)


def clouds(ending: str) -> Iterator[bytes]:
    points = tabletop()
    for some in (points, points[::3]):
        if ending == "npy":
            made = BytesIO()
            np.save(made, some)
            yield made.getvalue()
        else:
            cloud = trimesh.PointCloud(some)
            yield cloud.export(file_type="ply")
            yield trimesh.exchange.ply.export_ply(cloud, encoding="ascii")


def run_cloud(ending: str, data: bytes, folder: Path) -> None:
    path = folder / f"case.{ending}"
    path.write_bytes(data)
    with undone(loft().connection):
        view = (2, 2, 1.5, 0, 1.57)
        loft().observe_view(view, cloud=path, looked_for=["cup 1"])


FACTS = """
@prefix : <urn:semmap:map:loft#> . @prefix ex: <http://example.org/> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
:mug a ex:Mug ; rdfs:label "a mug"@en, "Tasse"@de ; ex:size 0.1, 5, true ; ex:near [ ex:of :desk ] .
:ann ex:said "2026-01-31T12:00:00Z"^^<http://www.w3.org/2001/XMLSchema#dateTime> ; ex:has (1 2) .
"""
FORMATS = {
    "turtle": ".ttl",
    "trig": ".trig",
    "json-ld": ".jsonld",
    "nt": ".nt",
    "nquads": ".nq",
    "xml": ".rdf",
}
ENTITIES = b"""<?xml version="1.0"?><!DOCTYPE r:RDF [<!ENTITY ex "http://example.org/">]>
<r:RDF xmlns:r="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:ex="&ex;" xml:base="&ex;">
<ex:Mug r:about="&ex;mug" ex:size="5"><ex:near r:nodeID="a"/><ex:of xml:lang="de">Tasse</ex:of>
<ex:parts r:parseType="Collection"><r:Description r:ID="b"/></ex:parts></ex:Mug></r:RDF>"""


def facts(format_: str) -> Iterator[bytes]:
    dataset = rdflib.Dataset()
    with without_warnings():
        dataset.parse(data=FACTS, format="turtle")
        if format_ in ("trig", "nquads"):
            told = dataset.graph(rdflib.URIRef("http://example.org/told"))
            told.parse(data=FACTS, format="turtle")
        yield dataset.serialize(format=format_).encode()
    if format_ in ("turtle", "trig"):
        yield FACTS.encode()
    if format_ == "xml":
        yield ENTITIES


def run_facts(format_: str, data: bytes, folder: Path) -> None:
    path = folder / f"case{FORMATS[format_]}"
    path.write_bytes(data)
    with undone(loft().connection):
        loft().import_rdf(path)


PEOPLE = person1(n=6)


def records(ending: str) -> Iterator[bytes]:
    data = PEOPLE.left
    if ending == ".csv":
        lines = [",".join(["id", *data.properties])]
        for key, *values in zip(data.keys, *data.properties.values(), strict=True):
            lines.append(",".join([key, *(";".join(value) for value in values)]))
        yield "\n".join(lines).encode()
        yield f'id,name\n{min(PEOPLE.links)[0]},"a, b"\n2,\n'.encode()
    else:
        yield rdf_xml(data, "Person").encode()


def run_records(ending: str, data: bytes, folder: Path) -> None:
    path = folder / f"case{ending}"
    path.write_bytes(data)
    interlink(path, {min(PEOPLE.links): True})


def run_links(ending: str, data: bytes, folder: Path) -> None:
    path = folder / f"case{ending}"
    path.write_bytes(data)
    interlink(PEOPLE.left, path)


def interlink(left: Path | Records, labels: Path | dict[tuple[str, str], bool]) -> None:
    with undone(loft().database.session):
        loft().database.interlink(left, PEOPLE.right, labels)
        loft().database.merged_records(loft().database.list_link_sets()[0]["id"])


def run_teaching(ending: str, data: bytes, folder: Path) -> None:
    path = folder / f"case{ending}"
    path.write_bytes(data)
    with undone(loft().connection):
        loft().teach(path)


PATTERNS = '''
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
ex:Named a sh:NodeShape ; sh:targetClass semmap:Cup , semmap:Sofa ;
    sh:property [ sh:path rdfs:label ; sh:pattern "^[a-z ]+[0-9]?$" ; sh:flags "i" ] ;
    sh:property [ sh:path [ sh:zeroOrMorePath semmap:heldBy ] ; sh:nodeKind sh:IRI ] ;
    sh:or ( [ sh:class semmap:Cup ] [ sh:not [ sh:class semmap:Room ] ] ) ;
    sh:sparql [ sh:select """SELECT $this ?value { $this <urn:semmap:property#mass> ?value
        FILTER(?value > 2) }""" ] .
'''


def shapes() -> list[bytes]:
    domain = schema_folder() / "shapes" / "domain.ttl"
    return [domain.read_bytes(), *((HEAD + text).encode() for text in (CUPS, PATTERNS))]


def run_shapes(data: bytes, folder: Path) -> None:
    path = folder / "case.ttl"
    path.write_bytes(data)
    loft().validate(path, seconds=SECONDS)
    with undone(loft().connection):
        loft().bind_shapes(path)
        loft().update("INSERT DATA { :cup%201 <urn:semmap:property#mass> 1.5 }")


TEXT = [words_of, words_of, bytes_of, lines_of]
TREES = {"json-ld": (json_tree, json_tree), "xml": (xml_tree, xml_tree)}
LINKS = "left,right,same\n" + "".join(f"{a},{b},yes\n" for a, b in sorted(PEOPLE.links)[:3])

KNOWLEDGE_FILE_KINDS = [
    *(
        Kind(
            f"cloud {ending}",
            partial(lambda e: list(clouds(e)), ending),
            [bytes_of, bytes_of, words_of],
            partial(run_cloud, ending),
        )
        for ending in ("npy", "ply")
    ),
    *(
        Kind(
            f"facts {format_}",
            partial(lambda f: list(facts(f)), format_),
            [*TEXT, *TREES.get(format_, ())],
            partial(run_facts, format_),
        )
        for format_ in FORMATS
    ),
    *(
        Kind(
            f"records {ending[1:]}",
            partial(lambda e: list(records(e)), ending),
            [*TEXT, xml_tree, xml_tree] if ending == ".rdf" else TEXT,
            partial(run_records, ending),
        )
        for ending in (".csv", ".rdf")
    ),
    Kind(
        "teaching json",
        lambda: [json.dumps(lesson()).replace("kitchen", "studio").encode()],
        [*TEXT, json_tree, json_tree],
        partial(run_teaching, ".json"),
    ),
    Kind(
        "teaching xml",
        lambda: [MAP_XML.encode()],
        [*TEXT, xml_tree, xml_tree],
        partial(run_teaching, ".xml"),
    ),
    Kind(
        "shapes",
        shapes,
        TEXT,
        run_shapes,
    ),
    Kind("links csv", lambda: [LINKS.encode()], TEXT, partial(run_links, ".csv")),
    Kind(
        "links rdf",
        lambda: [alignment_xml({*sorted(PEOPLE.links)[:2]}).encode()],
        [*TEXT, xml_tree, xml_tree],
        partial(run_links, ".rdf"),
    ),
]
