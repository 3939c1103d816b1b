"""What reaches the database: SPARQL, bundles and grasps, on a small map whose changes are undone.

The server is that of `SERVER`; whoever runs cases starts it (`served`).
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import psycopg
from nacl.signing import SigningKey

import semmap
from semmap.database.embedded import Cluster
from semmap.fields.queries import QueryError
from semmap.knowledge import KnowledgeError
from semmap.knowledge.queries import query
from semmap.knowledge.updates import update
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.household_objects import import_household_grasps
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.store.bundle import export_bundle, import_bundle, trust
from semmap.manipulation.store.devices import add_gripper
from semmap.manipulation.store.models import set_shape
from semmap.manipulation.store.tasks import record_task
from tests.fuzz.grammar import Grammar
from tests.fuzz.kind import SERVER, Kind
from tests.fuzz.mutate import NUMBERS, bytes_of, json_tree, lines_of, words_of
from tests.knowledge.conftest import STATED
from tests.knowledge.sparql.test_geosparql import RELATIONS
from tests.knowledge.test_query import QUERIES
from tests.manipulation.cup_map import candidate, primitive
from tests.manipulation.test_household_objects import grasp, write

KEY = SigningKey(bytes(range(32)))
SECONDS = 2.0
"""Of a query."""


@contextmanager
def served() -> Iterator[None]:
    """Run a server of its own with the map, for all processes that inherit the environment."""
    with TemporaryDirectory(prefix="semmap-fuzz-", ignore_cleanup_errors=True) as folder:
        Path(folder).chmod(0o755)
        cluster = Cluster(Path(folder))
        url = cluster.ensure().render_as_string(hide_password=False)
        try:
            prepare(url)
            os.environ[SERVER] = url
            yield
        finally:
            os.environ.pop(SERVER, None)
            cluster.stop()


def prepare(url: str) -> None:
    """Make a small map with statements, a gripper and what it learned."""
    with semmap.connect(url, migrate=True) as db:
        loft = db.create_map("loft")
        loft.add_room("studio", [(0, 0), (5, 0), (5, 4), (0, 4)], floor=0, ceiling=3)
        loft.add_object("table", type="dining_table", size=(1.6, 0.9, 0.75), pose=(2, 2, 0))
        for name, x in (("cup 1", 1.5), ("cup 2", 2.5)):
            loft.add_object(name, type="cup", size=(0.1, 0.1, 0.1), pose=(x, 2, 0.75))
        for name in ("sofa", "shelf/left", "ann", "bob"):
            loft.add_object(name, type="sofa", size=(1, 0.5, 0.8), pose=(4, 3, 0))
        session = loft.connection
        update(session, STATED)
        add_gripper(session, "two_fingers", form="parallel", opening=0.1, depth=0.05)
        set_shape(session, "cup 1", primitive("cuboid", 0.1, 0.1, 0.1))
        (known, _) = add_actions(session, "cup 1", None, [candidate(), candidate(yaw=1.0)])
        record_task(session, "cup 1", action=known, outcome="completed")
        trust(session, "other", bytes(KEY.verify_key).hex())


@cache
def loft() -> semmap.Map:
    """The map that this process has open."""
    return semmap.connect(os.environ[SERVER]).map("loft")


def close() -> None:
    """Close the map, if it is open."""
    if loft.cache_info().currsize:
        loft().database.close()
        loft.cache_clear()


@contextmanager
def undone() -> Iterator[psycopg.Connection[Any]]:
    """The session in a transaction that ends without a change, usable after what was refused."""
    here = loft().connection
    with here.transaction() as transaction:
        yield here
        raise psycopg.Rollback(transaction)


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
    with undone() as here:
        query(here, data.decode("utf-8", "replace"), seconds=SECONDS, rows=1000)


UPDATES = (
    "DELETE DATA { :cup%201 ex:likes ex:coffee }",
    'INSERT DATA { :mug a semmap:Mug ; semmap:placedOn :table ; rel:beside :sofa ; ex:is "hot" }',
    "DELETE { ?x ex:likes ?y } INSERT { ?y ex:likedBy ?x } WHERE { ?x ex:likes ?y }",
    "COPY ex:archive TO ex:copy ; CLEAR GRAPH ex:archive",
    "WITH :ann_believes DELETE { ?s ?p ?o } WHERE { ?s ?p ?o }",
    STATED.strip().partition("\n")[2],
)

STATE = (
    "SELECT (SELECT count(*) FROM entity), (SELECT md5(string_agg(t::text, ' ' ORDER BY t::text)) "
    "FROM statement t), (SELECT count(*) FROM map), (SELECT count(*) FROM link)"
)


def run_update(data: bytes, _: Path) -> None:
    with undone() as here:
        before = here.execute(STATE).fetchone()
        try:
            update(here, data.decode("utf-8", "replace"), seconds=SECONDS)
        except (QueryError, KnowledgeError):
            assert here.execute(STATE).fetchone() == before, "a refused update changes nothing"
            raise
        (others,) = here.execute("SELECT count(*) FROM map WHERE name <> 'loft'").fetchone() or ()
        assert others == 0


@cache
def bundles() -> list[bytes]:
    """What `prepare` taught, as a bundle without its signature."""
    with TemporaryDirectory() as folder, undone() as here:
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
    with undone() as here:
        here.execute("DELETE FROM action")
        import_bundle(here, path)
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
    with undone() as here:
        import_household_grasps(here, [path], {"WILLOW_GRIPPER_2010": "two_fingers"})
        for (pose,) in here.execute("SELECT pose FROM action").fetchall():
            assert np.isfinite(pose).all()


TEXT = [words_of, words_of, bytes_of, lines_of]
REFUSED = (QueryError, KnowledgeError)

STORED_KINDS = [
    Kind(
        "sparql",
        lambda: [(EXTRA + text).encode() for text in QUERIES],
        [*TEXT, *[new_query] * 6],
        run_query,
        REFUSED,
        server=True,
    ),
    Kind(
        "sparql update",
        lambda: [(EXTRA + text).encode() for text in UPDATES],
        [*TEXT, *[new_update] * 6],
        run_update,
        REFUSED,
        server=True,
    ),
    Kind(
        "bundle",
        bundles,
        [one_line, one_line, one_line, words_of, lines_of],
        run_bundle,
        (ManipulationError,),
        server=True,
    ),
    *(
        Kind(
            f"grasps {ending[1:]}",
            partial(lambda e: list(rows(e)), ending),
            [*TEXT, json_tree, json_tree] if ending == ".json" else TEXT,
            partial(run_rows, ending),
            (ManipulationError, LookupError),
            server=True,
        )
        for ending in (".csv", ".json", ".sql")
    ),
]
