"""``python -m benchmarks.clients`` runs the tests of foreign clients, and prints their table.

docs/conformance.md has it.
"""

from __future__ import annotations

import sys
from collections import Counter
from importlib.metadata import PackageNotFoundError, version

import pytest

from benchmarks.markdown import print_table

KNOWLEDGE = "tests/knowledge"
FOREIGN = f"{KNOWLEDGE}/test_foreign_clients.py"

CLIENTS: tuple[tuple[str, str, str, str], ...] = (
    ("rdflib", "rdflib", "queries and changes the map as a store", f"{FOREIGN}::test_rdflib"),
    ("SPARQLWrapper", "sparqlwrapper", "queries and changes it", f"{FOREIGN}::test_sparqlwrapper"),
    ("oxigraph", "pyoxigraph", "asks it by SERVICE", f"{FOREIGN}::test_oxigraph"),
    ("httpx", "httpx", "asks as pages of the web do: CORS, gzip, ETag, forms", f"{FOREIGN}::test_"),
    ("YASGUI in Chromium", "", "the query page", "tests/worlds/test_query_page.py"),
    ("Horned-OWL", "py-horned-owl", "reads exports as the OWL API does", f"{FOREIGN}::test_an_owl"),
    ("morph-kgc", "morph-kgc", "reads the database by R2RML", f"{KNOWLEDGE}/test_r2rml.py"),
    ("pykb", "pykb", "KnowledgeCore's protocol", f"{KNOWLEDGE}/test_knowledge_core_server.py"),
    ("psql", "", "runs what --explain prints", f"{KNOWLEDGE}/test_explain.py"),
)
"""A client, its package, what it does, and the tests of it: a file, or names that begin so."""


class _Outcomes:
    """Counts the outcomes of the tests of each client."""

    def __init__(self) -> None:
        self.of = {client: Counter[str]() for client, *_ in CLIENTS}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count the outcome of a test, or why it did not run."""
        if report.when == "call" or report.outcome != "passed":
            fits = [
                (len(of), client) for client, _, _, of in CLIENTS if report.nodeid.startswith(of)
            ]
            if fits:
                self.of[max(fits)[1]][report.outcome] += 1


def main() -> int:
    """Print the table; return the status of pytest."""
    outcomes = _Outcomes()
    files = dict.fromkeys(tests.partition("::")[0] for *_, tests in CLIENTS)
    status = pytest.main(["-q", "--no-header", *files], plugins=[outcomes])
    rows = []
    for client, package, does, tests in CLIENTS:
        count = outcomes.of[client]
        result = ", ".join(f"{number} {outcome}" for outcome, number in count.items()) or "none ran"
        rows.append((f"{client} {_version(package)}".strip(), does, f"`{tests}`", result))
    print_table("Clients", ("client", "does", "tests", "result"), rows)
    return int(status)


def _version(package: str) -> str:
    try:
        return version(package) if package else ""
    except PackageNotFoundError:  # it has an environment of its own
        return ""


if __name__ == "__main__":
    sys.exit(main())
