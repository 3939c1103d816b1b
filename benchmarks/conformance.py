"""The requirements of GeoSPARQL, and the W3C's tests of SPARQL beside rdflib and oxigraph.

``python -m benchmarks.conformance FOLDER`` runs all tests below a folder with manifests, such as
``test/DAWG/data-sparql11`` in the source distribution of rdflib 6.0.0: the evaluation tests, the
texts to read and to refuse, the protocol and the graph store. It prints how many pass and why the
others fail, in Markdown: docs/conformance.md has it.
"""

from __future__ import annotations

import csv
import io
import os
import shutil
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psycopg
import pyoxigraph
import rdflib
import rdflib.plugins.sparql
from rdflib.compare import isomorphic
from rdflib.namespace import RDF, RDFS

import semmap
from benchmarks.conformance_failures import why
from benchmarks.conformance_graph_store import STEPS, failed_steps
from benchmarks.conformance_manifest import MF, entries, file_of
from benchmarks.conformance_protocol import CHECKS, protocol_client, protocol_tests
from benchmarks.conformance_syntax import READERS, SyntaxCase, is_read, syntax_cases
from benchmarks.geosparql import CLASSES, classes, small_map
from benchmarks.markdown import print_table
from semmap import Database
from semmap.database import Cluster
from semmap.knowledge.facts import SKOLEM, Fact, FactWriter
from semmap.knowledge.map_view import MapView
from semmap.knowledge.queries import query
from semmap.knowledge.updates import update
from semmap.knowledge.whole_graph import facts

__all__ = ["Case", "cases", "empty_map", "main", "run"]

QT = rdflib.Namespace("http://www.w3.org/2001/sw/DataAccess/tests/test-query#")
UT = rdflib.Namespace("http://www.w3.org/2009/sparql/tests/test-update#")
RS = rdflib.Namespace("http://www.w3.org/2001/sw/DataAccess/tests/result-set#")

EVALUATED = {MF.QueryEvaluationTest, MF.CSVResultFormatTest, MF.UpdateEvaluationTest}
EVALUATED |= {UT.UpdateEvaluationTest}
FORMATS = {".srx": "xml", ".srj": "json", ".tsv": "tsv"}
ENGINES = ("semmap", "rdflib", "oxigraph")


@dataclass(frozen=True)
class Case:
    """A test of a manifest.

    Attributes
    ----------
    group, name : the folder of the manifest, and the name of the test in it
    request : the file with the query or update
    is_update : which of them it is
    data, named : the files of the default graph, and of each named graph
    result : the file with the result of a query
    is_lax : the result may have a row more than once
    results : the graphs that an update leads to, as `named`; "" for the default graph
    """

    group: str
    name: str
    request: Path
    is_update: bool
    data: tuple[Path, ...] = ()
    named: tuple[tuple[str, Path], ...] = ()
    result: Path | None = None
    is_lax: bool = False
    results: tuple[tuple[str, Path], ...] = ()

    @property
    def key(self) -> str:
        """The group and the name."""
        return f"{self.group}/{self.name}"

    @property
    def text(self) -> str:
        """The query or update, with its own IRI as base."""
        text = self.request.read_text(encoding="utf-8")
        return text if self.is_update else f"BASE <{self.request.as_uri()}>\n{text}"


def cases(folder: Path) -> Iterator[Case]:
    """Yield the evaluation tests of all manifests below a folder."""
    for manifest, test, path in entries(folder, EVALUATED):
        yield _case(manifest, test, path)


def _case(manifest: rdflib.Graph, test: Any, path: Path) -> Case:
    action, result = manifest.value(test, MF.action), manifest.value(test, MF.result)
    request = manifest.value(action, QT.query) or manifest.value(action, UT.request)
    is_update = manifest.value(action, UT.request) is not None

    def files(node: Any, verb: Any) -> Iterator[Path]:
        yield from (file_of(found) for found in manifest.objects(node, verb))

    def named(node: Any) -> Iterator[tuple[str, Path]]:
        for found in manifest.objects(node, QT.graphData):
            yield str(found), file_of(found)
        for found in manifest.objects(node, UT.graphData):
            file = manifest.value(found, UT.graph) or manifest.value(found, UT.data)
            yield str(manifest.value(found, RDFS.label)), file_of(file)

    data = (*files(action, QT.data), *files(action, UT.data))
    graphs = dict(named(action))
    for iri, file in _chosen(file_of(request)) if not is_update else ():
        graphs.setdefault(iri, file)
    results = [("", file) for file in files(result, UT.data)] + list(named(result))
    return Case(
        path.parent.name,
        str(test).rsplit("#", 1)[-1],
        file_of(request),
        is_update,
        data,
        tuple(graphs.items()),
        None if is_update else file_of(result),
        manifest.value(test, MF.resultCardinality) == MF.LaxCardinality,
        tuple(results),
    )


def _chosen(request: Path) -> Iterator[tuple[str, Path]]:
    """Yield the graphs that FROM names, where they are files."""
    import re

    for name in re.findall(r"FROM\s+(?:NAMED\s+)?<([^>]*)>", request.read_text(encoding="utf-8")):
        file = request.parent / name
        if file.is_file():
            yield file.as_uri(), file


# Outcomes


@dataclass(frozen=True)
class Outcome:
    """What a query or update leads to: rows, an answer of yes or no, or graphs by name."""

    names: frozenset[str] = frozenset()
    rows: tuple[dict[str, Any], ...] | None = None
    truth: bool | None = None
    graphs: dict[str, rdflib.Graph] = field(default_factory=dict)


def expected(case: Case) -> Outcome:
    """Return what a test expects."""
    if case.is_update:
        return Outcome(graphs={name: _graph([file]) for name, file in case.results})
    assert case.result is not None
    ending = case.result.suffix
    if ending == ".csv":
        head, *lines = csv.reader(io.StringIO(case.result.read_text(encoding="utf-8")))
        texts = tuple({n: t for n, t in zip(head, line, strict=True) if t} for line in lines)
        return Outcome(frozenset(head), texts)
    if ending in FORMATS:
        with case.result.open("rb") as file:
            found = rdflib.query.Result.parse(file, format=FORMATS[ending])
        return of_result(found)
    graph = _graph([case.result])
    table = next(iter(graph.subjects(RDF.type, RS.ResultSet)), None)
    if table is None:
        return Outcome(graphs={"": graph})
    truth = graph.value(table, RS.boolean)
    if truth is not None:
        return Outcome(truth=str(truth) == "true")
    names = frozenset(str(name) for name in graph.objects(table, RS.resultVariable))
    rows = tuple(
        {
            str(graph.value(b, RS.variable)): graph.value(b, RS.value)
            for b in graph.objects(row, RS.binding)
        }
        for row in graph.objects(table, RS.solution)
    )
    return Outcome(names, rows)


def of_result(found: Any) -> Outcome:
    """Return the outcome that a result of rdflib has."""
    if found.type == "ASK":
        return Outcome(truth=bool(found.askAnswer))
    if found.type in ("CONSTRUCT", "DESCRIBE"):
        return Outcome(graphs={"": found.graph})
    names = [str(name) for name in found.vars or ()]
    rows = tuple(
        {str(n): t for n, t in binding.items() if t is not None and str(n) in names}
        for binding in found.bindings
    )
    return Outcome(frozenset(names), rows)


def is_same(case: Case, found: Outcome, wanted: Outcome) -> bool:
    """Return whether two outcomes are the same, but for the names of blank nodes."""
    if wanted.rows is None or found.rows is None:
        names = {n for o in (found, wanted) for n, g in o.graphs.items() if len(g)}
        empty = rdflib.Graph()
        return (found.truth, found.rows is None) == (wanted.truth, wanted.rows is None) and all(
            isomorphic(*(_canonical(o.graphs.get(name, empty)) for o in (found, wanted)))
            for name in names
        )
    if found.names != wanted.names:
        return False
    if case.result is not None and case.result.suffix == ".csv":
        texts = [
            Counter(frozenset((n, _text(t)) for n, t in row.items()) for row in o.rows or ())
            for o in (found, wanted)
        ]
        return texts[0] == texts[1]
    graphs = (_as_graph(rows, case.is_lax) for rows in (found.rows, wanted.rows))
    return isomorphic(*graphs)


def _text(term: Any) -> str:
    if isinstance(term, rdflib.URIRef):
        term = _plain(term)
    return "_:" if isinstance(term, rdflib.BNode) or str(term).startswith("_:") else str(term)


def _as_graph(rows: tuple[dict[str, Any], ...], is_lax: bool) -> rdflib.Graph:
    graph = rdflib.Graph()
    for row, times in _counted(rows).items():
        node = rdflib.BNode()
        graph.add((node, RDF.value, rdflib.Literal(1 if is_lax else times)))
        for name, term in row:
            graph.add((node, rdflib.URIRef(f"urn:name:{name}"), term))
    return graph


def _counted(rows: tuple[dict[str, Any], ...]) -> Counter[frozenset[tuple[str, Any]]]:
    return Counter(frozenset((n, _plain(t)) for n, t in row.items()) for row in rows)


def _canonical(graph: rdflib.Graph) -> rdflib.Graph:
    found = rdflib.Graph()
    for triple in graph:
        s, p, o = map(_plain, triple)
        found.add((s, p, o))
    return found


_NUMBERS = {
    rdflib.XSD[name]: kind
    for kind, names in (
        (int, ("integer", "int", "long", "short", "byte")),
        (float, ("decimal", "double", "float")),
    )
    for name in names
}


def _plain(term: Any) -> Any:
    """Return a term with the canonical text of its value; IRIs of blank nodes as blank nodes."""
    if isinstance(term, rdflib.URIRef) and term.startswith(SKOLEM):
        return rdflib.BNode(str(term)[len(SKOLEM) :])
    if not isinstance(term, rdflib.Literal):
        return term
    if term.language:
        return rdflib.Literal(str(term), lang=term.language.lower())
    if term.datatype in (None, rdflib.XSD.string):
        return rdflib.Literal(str(term))
    try:
        text = repr(_NUMBERS[term.datatype](str(term)))
    except (KeyError, ValueError):
        text = str(term)
    return rdflib.Literal(text, datatype=term.datatype, normalize=False)


def _graph(files: Any) -> rdflib.Graph:
    graph = rdflib.Graph()
    for file in files:
        format_ = "xml" if file.suffix in (".rdf", ".xml") else "turtle"
        graph.parse(file, publicID=file.as_uri(), format=format_)
    return graph


# Engines


def by_rdflib(case: Case) -> Outcome:
    """Evaluate a test by rdflib, in memory."""
    dataset = rdflib.ConjunctiveGraph()  # of an rdflib.Dataset, updates of whole graphs fail
    for triple in _graph(case.data):
        dataset.default_context.add(triple)
    for name, file in case.named:
        for triple in _graph([file]):
            dataset.get_context(rdflib.URIRef(name)).add(triple)
    if not case.is_update:
        return of_result(dataset.query(case.text))
    dataset.update(case.text)
    default = dataset.default_context.identifier
    graphs = {"" if g.identifier == default else str(g.identifier): g for g in dataset.contexts()}
    return Outcome(graphs=graphs)


def by_oxigraph(case: Case) -> Outcome:
    """Evaluate a test by oxigraph, in memory."""
    store = pyoxigraph.Store()
    for name, file in [("", f) for f in case.data] + list(case.named):
        store.load(
            _graph([file]).serialize(format="nt").encode(),
            format=pyoxigraph.RdfFormat.N_TRIPLES,
            to_graph=pyoxigraph.NamedNode(name) if name else None,
        )
    if case.is_update:
        store.update(case.text)
        texts: dict[str, str] = {}
        for quad in store:
            line = f"{quad.subject} {quad.predicate} {quad.object} .\n"
            name = getattr(quad.graph_name, "value", "")
            texts[name] = texts.get(name, "") + line
        return Outcome(
            graphs={n: rdflib.Graph().parse(data=t, format="nt") for n, t in texts.items()}
        )
    found = store.query(case.text)
    if isinstance(found, pyoxigraph.QueryTriples):
        text = found.serialize(format=pyoxigraph.RdfFormat.N_TRIPLES)
        return Outcome(graphs={"": rdflib.Graph().parse(data=text, format="nt")})
    answer = io.BytesIO()
    found.serialize(answer, format=pyoxigraph.QueryResultsFormat.JSON)
    answer.seek(0)
    return of_result(rdflib.query.Result.parse(answer, format="json"))


def by_semmap(case: Case, session: psycopg.Connection[Any]) -> Outcome:
    """Evaluate a test on an empty map whose statements are the test's data."""
    with session.transaction() as transaction:
        writer = FactWriter(MapView.of(session))
        writer.insert(Fact(*triple) for triple in _graph(case.data))
        for name, file in case.named:
            FactWriter(MapView.of(session)).insert(
                Fact(*triple, rdflib.URIRef(name)) for triple in _graph([file])
            )
        if case.is_update:
            update(session, case.text)
            graphs: dict[str, rdflib.Graph] = {}
            for s, p, o, graph in facts(session):
                graphs.setdefault(str(graph or ""), rdflib.Graph()).add((s, p, o))
            found = Outcome(graphs=graphs)
        else:
            answer = query(session, case.text, seconds=20)
            if answer.form == "SELECT":
                rows = tuple(
                    {n: t for n, t in zip(answer.names, row, strict=True) if t is not None}
                    for row in answer.rows
                )
                found = Outcome(frozenset(answer.names), rows)
            elif answer.form == "ASK":
                found = Outcome(truth=answer.truth)
            else:
                found = Outcome(graphs={"": answer.graph or rdflib.Graph()})
        raise psycopg.Rollback(transaction)
    return found


@contextmanager
def scratch() -> Iterator[Database]:
    """A database of its own, which is gone afterwards."""
    folder = Path(tempfile.mkdtemp(prefix="semmap-conformance-"))
    folder.chmod(0o755)
    os.environ["SEMMAP_DATA"] = str(folder)
    try:
        with semmap.connect() as database:
            yield database
    finally:
        Cluster(folder).stop()
        shutil.rmtree(folder)


def empty_map(database: Database) -> psycopg.Connection[Any]:
    """Return a session that sees an empty map; the other maps and the T-Box go."""
    for name in database.maps:
        database.drop_map(name)
    session = database.create_map("empty").connection
    session.execute("DELETE FROM type_parent")
    session.execute("DELETE FROM semantic_type")
    session.commit()
    return session


def run(case: Case, engine: Callable[[Case], Outcome]) -> str:
    """Run a test; return "" where it passes, else what is wrong."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = engine(case)
        wanted = expected(case)
    except Exception as error:  # whatever an engine raises is its failure
        return f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"
    return "" if is_same(case, found, wanted) else "another result"


def main(folder: Path) -> int:
    """Print the tables; return how many failures of the map have no explanation."""
    rdflib.NORMALIZE_LITERALS = False
    rdflib.plugins.sparql.SPARQL_DEFAULT_GRAPH_UNION = False
    rdflib.plugins.sparql.SPARQL_LOAD_GRAPHS = False
    tests = [case for case in cases(folder) if case.group != "service"]
    failures: dict[str, dict[str, str]] = {engine: {} for engine in ENGINES}
    with scratch() as database:
        print_table("GeoSPARQL 1.1", CLASSES, classes(small_map(database)))
        session = empty_map(database)
        engines = (lambda case: by_semmap(case, session), by_rdflib, by_oxigraph)
        for case in tests:
            for name, engine in zip(ENGINES, engines, strict=True):
                if reason := run(case, engine):
                    failures[name][case.key] = reason
        requests = protocol_tests(folder)
        with protocol_client(database, "empty") as client:
            refused = [f"protocol/{name}" for name in requests if not CHECKS[name](client)]
            not_stored = [f"graph-store/{name}" for name in failed_steps(client)]
    _print_passes("SPARQL 1.1: tests passed", tests, failures)
    _print_failures("What the map fails", failures)
    texts = list(syntax_cases(folder))
    wrong = {
        name: {case.key: reason for case in texts if (reason := is_read(case, reader))}
        for name, reader in READERS.items()
    }
    for kind, is_sparql in (("to read", True), ("to refuse", False)):
        of_kind = [case for case in texts if case.is_sparql == is_sparql]
        _print_passes(f"SPARQL 1.1: texts {kind}", of_kind, wrong)
    _print_failures("What is refused, or read, on purpose", wrong)
    _print_protocol("protocol", len(requests), refused)
    _print_protocol("graph store", len({step.test for step in STEPS}), not_stored)
    unmet = (*failures["semmap"], *wrong["semmap"], *refused, *not_stored)
    return sum(why(key) is None for key in unmet)


def _print_passes(
    title: str, tests: Sequence[Case | SyntaxCase], failures: dict[str, dict[str, str]]
) -> None:
    groups = Counter(case.group for case in tests)
    keys = {case.key for case in tests}

    def passed(count: int, of: str) -> list[int]:
        failed = {e: sum(k in keys and k.startswith(of) for k in failures[e]) for e in ENGINES}
        return [count - number for number in failed.values()]

    rows = [[group, count, *passed(count, f"{group}/")] for group, count in groups.items()]
    rows.append(["all", len(tests), *passed(len(tests), "")])
    print_table(title, ("group", "tests", *ENGINES), rows)


def _print_failures(title: str, failures: dict[str, dict[str, str]]) -> None:
    shown: dict[tuple[str, str], list[str]] = {}
    for key, reason in failures["semmap"].items():
        beside = "fails, too" if key in failures["rdflib"] else "passes"
        shown.setdefault((why(key) or f"NOT EXPLAINED: {reason}", beside), []).append(key)
    rows = []
    for (explanation, beside), keys in shown.items():
        more = f" and {len(keys) - 6} more" if len(keys) > 6 else ""
        rows.append([", ".join(keys[:6]) + more, explanation, beside])
    print_table(title, ("tests", "why", "rdflib"), rows)


def _print_protocol(name: str, count: int, failed: list[str]) -> None:
    title = f"SPARQL 1.1 {name}: {count - len(failed)} of {count} pass"
    rows = [[key, why(key) or "NOT EXPLAINED"] for key in failed]
    print_table(title, ("test that fails", "why"), rows)


if __name__ == "__main__":
    sys.exit(bool(main(Path(sys.argv[1]))))
