"""SPARQL, bundles and grasps, on a small map whose changes are undone."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import numpy as np

from semmap.error import Error
from semmap.manipulation.store.bundle import export_bundle
from tests.fuzz.grammar import Grammar
from tests.fuzz.kind import Kind
from tests.fuzz.mutate import NUMBERS, bytes_of, json_tree, lines_of, words_of
from tests.fuzz.server import KEY, loft, undone
from tests.knowledge.conftest import STATED
from tests.knowledge.sparql.test_geosparql import RELATIONS
from tests.knowledge.test_query import QUERIES
from tests.manipulation.test_household_objects import grasp, write

SECONDS = 2.0
"""Of a query."""

EXTRA = "PREFIX ex: <http://example.org/>\n"
NOUNS = (
    ":table",
    ":cup%201",
    "ex:coffee",
    "semmap:Cup",
    "'tea'@en",
    "5",
    "-1e308",
    "?a",
    "?b",
    "?c",
    "_:x",
    "[]",
    '"POINT(1 2)"^^geo:wktLiteral',
    '"NaN"^^xsd:double',
    '"x"^^xsd:integer',
)
VERBS = (
    "a",
    "semmap:name",
    "semmap:heldBy",
    "semmap:heldBy+",
    "^semmap:heldBy*",
    "(ex:likes|^rel:beside)?",
    "!(a|ex:likes)",
    "ex:likes",
    "prop:colour",
    "rdfs:label",
    "geo:hasGeometry/geo:asWKT",
    "?p",
    *(f"geo:{name}" for name in [*RELATIONS][:4]),
)
FUNCTIONS = (
    "STR",
    "LANG",
    "DATATYPE",
    "STRLEN",
    "UCASE",
    "ENCODE_FOR_URI",
    "ABS",
    "CEIL",
    "YEAR",
    "SECONDS",
    "TZ",
    "MD5",
    "isNumeric",
    "xsd:integer",
    "xsd:dateTime",
    "IRI",
    "BNODE",
    "geof:area",
    "geof:envelope",
    "geof:convexHull",
    "!",
    "-",
    "COUNT",
    "SUM",
    "GROUP_CONCAT",
    "SAMPLE",
)
TWO = ("STRDT", "STRLANG", "CONTAINS", "STRBEFORE", "geof:distance", "geof:union", "LANGMATCHES")
SIGNS = ("=", "!=", "<", ">=", "+", "-", "*", "/", "&&", "||", "IN", "NOT IN")


class SparqlGrammar(Grammar):
    """Sentences of SPARQL 1.1 with updates."""

    NOUNS, DATA, VERBS = NOUNS, NOUNS[:7], VERBS

    def query(self) -> str:
        pick = self.random.choice
        expression = self.expression()
        head = pick(
            (
                "SELECT *",
                "SELECT DISTINCT ?a ?b",
                "SELECT REDUCED ?a",
                "ASK",
                f"SELECT (COUNT(DISTINCT {expression}) AS ?n)",
                f"SELECT ?a (SUM({expression}) AS ?n)",
                f"SELECT ({expression} AS ?n)",
                "CONSTRUCT { ?a ex:has ?b }",
                "DESCRIBE ?a",
            )
        )
        tails = (
            "",
            f" ORDER BY DESC({self.expression()})",
            " GROUP BY ?a",
            f" LIMIT {pick(NUMBERS)}",
            f" OFFSET {pick(NUMBERS)}",
            f" HAVING ({self.expression()})",
            " VALUES (?a ?b) { (:table UNDEF) }",
        )
        tail = "".join(pick(tails) for _ in range(pick((0, 0, 1, 3))))
        return f"{head} {pick(('', 'FROM ex:archive '))}WHERE {self.group()}{tail}"

    def own_part(self) -> str:
        pick = self.random.choice
        if self.random.random() < 0.5:
            return f"GRAPH {pick(('?g', ':ann_believes', 'ex:archive'))} {self.group()}"
        return f"SERVICE {pick(('', 'SILENT '))}ex:elsewhere {self.group()}"

    def expression(self) -> str:
        self.left -= 1
        pick = self.random.choice
        if self.left < 0 or self.random.random() < 0.3:
            return pick((*NOUNS[:10], *NOUNS[12:], *NUMBERS, "true"))
        match self.random.randrange(6):
            case 0 | 1:
                return f"{pick(FUNCTIONS)}({self.expression()})"
            case 2:
                regex = "".join(pick("au.()*+?{2}|[]^$\\") for _ in range(pick((0, 3, 9))))
                return f"REGEX(STR(?a), {json.dumps(regex)}, '{pick(('', 'i', 'x', 'q'))}')"
            case 3:
                return f"IF({self.expression()}, {self.expression()}, {self.expression()})"
            case 4:
                return f"{pick(TWO)}({self.expression()}, {self.expression()})"
            case _:
                return f"({self.expression()} {pick(SIGNS)} {self.expression()})"

    def request(self) -> str:
        pick = self.random.choice
        match self.random.randrange(6):
            case 0 | 1:
                return f"{pick(('INSERT', 'DELETE'))} DATA {{ {self.pattern()} {self.pattern()} }}"
            case 2:
                return f"DELETE WHERE {{ {self.pattern()} }}"
            case 3:
                verb, graphs = pick(("CLEAR", "DROP")), ("DEFAULT", "NAMED", "GRAPH ex:archive")
                return f"{verb} {pick(graphs)}"
            case 4:
                return f"{pick(('COPY', 'MOVE', 'ADD'))} ex:archive TO {pick(('ex:new', ':ann'))}"
            case _:
                return (
                    f"DELETE {{ {self.pattern()} }} INSERT {{ {self.pattern()} }} "
                    f"WHERE {self.group()}"
                )


def new_query(random: Random, _: bytes, __: Sequence[bytes]) -> bytes:
    """A query of the grammar."""
    return (EXTRA + SparqlGrammar(random).query()).encode("utf-8", "replace")


def new_update(random: Random, _: bytes, __: Sequence[bytes]) -> bytes:
    """Requests of the grammar."""
    requests = (SparqlGrammar(random).request() for _ in range(random.choice((1, 1, 2, 5))))
    return (EXTRA + " ; ".join(requests)).encode("utf-8", "replace")


def run_query(data: bytes, _: Path) -> None:
    loft().sparql(data.decode("utf-8", "replace"), seconds=SECONDS, rows=1000)


UPDATES = (
    "DELETE DATA { :cup%201 ex:likes ex:coffee }",
    'INSERT DATA { :mug a semmap:Mug ; semmap:placedOn :table ; rel:beside :sofa ; ex:is "hot" }',
    "DELETE { ?x ex:likes ?y } INSERT { ?y ex:likedBy ?x } WHERE { ?x ex:likes ?y }",
    "COPY ex:archive TO ex:copy ; CLEAR GRAPH ex:archive",
    "WITH :ann_believes DELETE { ?s ?p ?o } WHERE { ?s ?p ?o }",
    STATED.strip().partition("\n")[2],
)

STATE = """
SELECT (SELECT count(*) FROM entity e WHERE e.map_id = m.id), (SELECT count(*) FROM entity e JOIN
link l ON l.from_id = e.id WHERE e.map_id = m.id), (SELECT md5(string_agg(t::text, ' ' ORDER BY
t::text)) FROM statement t WHERE t.map_id = m.id), (SELECT count(*) FROM map o WHERE NOT
starts_with(o.name, 'case ')) FROM map m WHERE m.name = 'loft'
"""
"""The content of the map, and the number of maps but for those that other processes import."""


def run_update(data: bytes, _: Path) -> None:
    here = loft().connection
    with undone(here):
        before = here.execute(STATE).fetchone()
        try:
            loft().update(data.decode("utf-8", "replace"), seconds=SECONDS)
        except Error:
            assert here.execute(STATE).fetchone() == before, "a refused update changes nothing"
            raise
        assert (here.execute(STATE).fetchone() or ())[-1] == (before or ())[-1]


@cache
def bundles() -> list[bytes]:
    """What `prepare` taught, as a bundle without its signature."""
    here = loft().connection
    with TemporaryDirectory() as folder, undone(here):
        path = Path(folder) / "bundle"
        export_bundle(here, path, "other", simulated=True, key=KEY)
        return [path.read_bytes().rstrip(b"\n").rpartition(b"\n")[0] + b"\n"]


def one_line(random: Random, seed: bytes, _: Sequence[bytes]) -> bytes:
    """A bundle with a line whose JSON is changed."""
    lines = seed.splitlines()
    number = random.randrange(1, len(lines))
    lines[number] = json_tree(random, lines[number], lines[1:4]).replace(b"\n", b" ")
    return b"\n".join(lines) + b"\n"


def run_bundle(data: bytes, folder: Path) -> None:
    """Import what a trusted contributor signed, in a database that lost what it says."""
    path = folder / "bundle"
    signature = json.dumps({"signature": KEY.sign(data).signature.hex()}).encode()
    path.write_bytes(data + signature + b"\n")
    here = loft().database.session
    with undone(here):
        here.execute("DELETE FROM action")
        loft().database.import_manipulation(path)
        (wrong,) = here.execute(
            "SELECT count(*) FROM action WHERE NOT (expected >= 0 AND expected <= 1)"
        ).fetchone() or (1,)
        assert wrong == 0


def rows(ending: str) -> Iterator[bytes]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"rows{ending}"
        position = "{0,0,0.1,1,0,0,0}"
        write(path, [grasp(), grasp(grasp_id=2, grasp_energy="3", grasp_grasp_position=position)])
        yield path.read_bytes()


def run_rows(ending: str, data: bytes, folder: Path) -> None:
    path = folder / f"rows{ending}"
    path.write_bytes(data)
    here = loft().database.session
    with undone(here):
        loft().database.import_grasps([path], {"WILLOW_GRIPPER_2010": "two_fingers"})
        for (pose,) in here.execute("SELECT pose FROM action").fetchall():
            assert np.isfinite(pose).all()


TEXT = [words_of, words_of, bytes_of, lines_of]

STORED_KINDS = [
    Kind(
        "sparql",
        lambda: [(EXTRA + text).encode() for text in QUERIES],
        [*TEXT, *[new_query] * 6],
        run_query,
        server=True,
    ),
    Kind(
        "sparql update",
        lambda: [(EXTRA + text).encode() for text in UPDATES],
        [*TEXT, *[new_update] * 6],
        run_update,
        server=True,
    ),
    Kind(
        "bundle",
        bundles,
        [one_line, one_line, one_line, words_of, lines_of],
        run_bundle,
        server=True,
    ),
    *(
        Kind(
            f"grasps {ending[1:]}",
            partial(lambda e: list(rows(e)), ending),
            [*TEXT, json_tree, json_tree] if ending == ".json" else TEXT,
            partial(run_rows, ending),
            server=True,
        )
        for ending in (".csv", ".json", ".sql")
    ),
]
