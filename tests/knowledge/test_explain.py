"""What `semmap sparql --explain` prints: SQL that psql runs, plans, and what rdflib evaluates."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from semmap import Map
from semmap.knowledge.vocabulary import prefixes
from tests.command_line import semmap

ODD = r"a 'quote', \\ %s %(p0)s :x \n -- ; \"$1\" β"
IN_BLANK_NODES = "SELECT ?x (BNODE(?x) AS ?n) { ?x a semmap:Sofa ; prop:colour ?c }"


def explained(made: Map, text: str, *words: str) -> str:
    url = made.engine.url.render_as_string(hide_password=False)
    return semmap(url, "sparql", text, "--map", made.name, "--explain", *words).stdout


def ran(made: Map, script: str) -> list[list[str]]:
    """Return the rows that psql prints of a script, in a session without settings."""
    url = made.engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    command = ["psql", "-XqAt", "-F", "\t", "-R", "\x1e", "-v", "ON_ERROR_STOP=1", url]
    done = subprocess.run(command, input=script, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    rows = done.stdout.removesuffix("\n").split("\x1e")
    return [row.split("\t") for row in rows]


@pytest.mark.skipif(shutil.which("psql") is None, reason="psql is not installed")
@pytest.mark.parametrize(
    "text",
    [
        "SELECT ?x ?n { ?x a semmap:Table ; semmap:name ?n }",
        f'SELECT ?x ("{ODD}" AS ?t) {{ ?x semmap:name ?n FILTER(?n != "{ODD}") }}',
        "SELECT ?x { ?x semmap:near :table ; geo:sfWithin :studio }",
        "SELECT ?x ?y { ?x rdfs:label ?y } LIMIT 2",
        "SELECT ?x { VALUES ?x { :sofa :cup%201 } ?x semmap:x ?d FILTER(?d > -1.5e0) }",
    ],
)
def test_psql_runs_what_it_prints(loft_map: Map, text: str) -> None:
    script = explained(loft_map, text)
    answer = loft_map.sparql(text)
    assert len(answer.rows) > 0
    found = sorted(row[::2] for row in ran(loft_map, script))  # texts; tags are between them
    assert found == sorted([str(term) for term in row] for row in answer.rows)


def test_the_plan_is_that_of_the_server(loft_map: Map) -> None:
    script = explained(loft_map, "SELECT ?x { ?x a semmap:Sofa }")
    assert "\n-- Execution Time: " in script
    assert "Scan" in script
    kinds = [each["kind"] for each in parts(loft_map, "SELECT ?x { ?x a semmap:Sofa }")]
    assert kinds == ["settings", "sql", "plan"]


@pytest.mark.skipif(shutil.which("psql") is None, reason="psql is not installed")
def test_it_says_what_rdflib_evaluates_and_why(loft_map: Map) -> None:
    script = explained(loft_map, IN_BLANK_NODES)
    assert "-- evaluated by rdflib, because BNODE with a label has no translation" in script
    assert any("urn:semmap:map:loft#sofa" in row for row in ran(loft_map, script))
    _, why, *read = parts(loft_map, IN_BLANK_NODES)
    assert why["kind"] == "rdflib"
    assert {each["kind"] for each in read} == {"sql", "plan"}
    of_type = f"-- ?s <{prefixes('')['rdf']}type> <{prefixes('')['semmap']}Sofa>\n"
    assert read[0]["text"].startswith(of_type)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("SELECT (TZ(NOW()) AS ?z) {}", "TZ has no translation"),
        ("SELECT (<urn:x:f>(1) AS ?z) {}", "there is no function <urn:x:f>"),
        ("SELECT (BNODE('a') AS ?z) {}", "BNODE with a label has no translation"),
    ],
)
def test_the_reason_names_the_part(loft_map: Map, text: str, part: str) -> None:
    assert part in parts(loft_map, text)[1]["text"]


def parts(made: Map, text: str) -> list[dict[str, str]]:
    found: list[dict[str, str]] = json.loads(explained(made, text, "--json"))
    return found
