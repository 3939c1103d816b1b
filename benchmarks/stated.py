"""Stated facts beside oxigraph: loading them, and stars, paths, OPTIONAL and counts.

``SEMMAP_BENCH_FACTS=100000 python -m benchmarks stated`` leaves the larger store out.
"""

from __future__ import annotations

import os
import random
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pyoxigraph

from benchmarks.bench_map import fresh_map
from benchmarks.timing import Row, medians_in_turn, print_rows
from semmap import Map
from semmap.limits import TEXT_BYTES

__all__ = ["main"]

FACTS = tuple(map(int, os.environ.get("SEMMAP_BENCH_FACTS", "100000,1000000").split(",")))
NAME = "stated"
OF_A_THING = 6.5
"""Facts of each thing, on average."""

TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"
DOUBLE = "http://www.w3.org/2001/XMLSchema#double"
PREFIX = "PREFIX ex: <http://example.org/> PREFIX thing: <http://example.org/thing/>\n"

QUESTIONS = {
    "star of three constants": "SELECT ?x { ?x a ex:Class7 ; ex:colour 'red' ; ex:in thing:157 }",
    "star of a class": "SELECT ?x ?n ?w { ?x a ex:Class7 ; ex:name ?n ; ex:weight ?w }",
    "star of all things": "SELECT ?x ?y ?c { ?x ex:in ?y ; ex:colour ?c }",
    "path of three steps": "SELECT ?a ?d { ?a a ex:Class3 ; ex:next/ex:next/ex:next ?d }",
    "path of 700 steps": "SELECT ?b { thing:{last} ex:next+ ?b }",
    "OPTIONAL": "SELECT ?x ?n { ?x a ex:Class7 OPTIONAL { ?x ex:note ?n } }",
    "count": "SELECT (COUNT(*) AS ?n) { ?x ex:name ?y }",
    "count by value": "SELECT ?c (COUNT(?x) AS ?n) { ?x ex:colour ?c } GROUP BY ?c",
    "count by class": "SELECT ?c (COUNT(?x) AS ?n) { ?x a ?c ; ex:colour 'red' } GROUP BY ?c",
}


def triples(things: int) -> Iterator[str]:
    """Yield the facts of things as N-Triples."""
    draw, space = random.Random(1), "http://example.org/"
    for i in range(things):
        thing = f"<{space}thing/{i}>"
        yield f"{thing} <{TYPE}> <{space}Class{i % 50}> .\n"
        yield f'{thing} <{space}name> "thing {i}" .\n'
        yield f'{thing} <{space}colour> "{draw.choice(("red", "green", "blue"))}" .\n'
        yield f'{thing} <{space}weight> "{draw.random()}"^^<{DOUBLE}> .\n'
        yield f"{thing} <{space}in> <{space}thing/{i % 1000}> .\n"
        if i + 1 < things:
            yield f"{thing} <{space}next> <{space}thing/{i + 1}> .\n"
        if i % 2:
            yield f'{thing} <{space}note> "note of {i}"@en .\n'


def values_of_oxigraph(store: pyoxigraph.Store, text: str) -> list[list[str | None]]:
    """Return the texts of an answer's terms."""
    found = store.query(text)
    assert isinstance(found, pyoxigraph.QuerySolutions)
    return [[term and str(term.value) for term in row] for row in found]


def loading(on: Map, store: pyoxigraph.Store, file: Path, facts: int) -> Row:
    """The import of a file."""
    start = time.perf_counter()
    added = on.import_rdf(file)
    ours = time.perf_counter() - start
    start = time.perf_counter()
    store.bulk_load(path=str(file), format=pyoxigraph.RdfFormat.N_TRIPLES)
    theirs = time.perf_counter() - start
    assert added == len(store)
    most = 3 * facts / 100_000
    return Row(
        f"load {added:,} facts",
        f"{ours:.1f} s",
        f"oxigraph: {theirs:.1f} s",
        f"{most:g} s",
        ours <= most,
    )


def asked(on: Map, store: pyoxigraph.Store, name: str, text: str) -> Row:
    """A question, answered by both with the values of all rows."""
    text = PREFIX + text
    ours = [[None if t is None else str(t) for t in row] for row in on.sparql(text).rows]
    assert sorted(map(str, ours)) == sorted(map(str, values_of_oxigraph(store, text))), name
    mine, theirs = medians_in_turn(
        lambda: [[None if t is None else str(t) for t in row] for row in on.sparql(text).rows],
        lambda: values_of_oxigraph(store, text),
    )
    return Row(
        f"{name} ({len(ours):,} rows)",
        f"{1e3 * mine:.2f} ms",
        f"oxigraph: {1e3 * theirs:.2f} ms",
        "within 5x",
        mine <= 5 * theirs,
    )


def main() -> None:
    """Print the tables."""
    for facts in FACTS:
        things = int(facts / OF_A_THING)
        os.environ[TEXT_BYTES.variable] = str(max(int(TEXT_BYTES.value), 200 * facts))
        with (
            tempfile.TemporaryDirectory() as folder,
            fresh_map(NAME, lambda db: db.create_map(NAME)) as (_, on),
        ):
            file, store = Path(folder, "facts.nt"), pyoxigraph.Store()
            file.write_text("".join(triples(things)), encoding="utf-8")
            rows = [loading(on, store, file, facts)]
            store.optimize()
            rows += [
                asked(on, store, kind, text.replace("{last}", str(things - 701)))
                for kind, text in QUESTIONS.items()
            ]
        print_rows(f"{facts:,} stated facts", rows)


if __name__ == "__main__":
    main()
