"""The W3C's syntax tests of SPARQL: texts to read, and texts to refuse."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pyoxigraph
from rdflib.namespace import RDF
from rdflib.plugins.sparql import prepareQuery, prepareUpdate

from benchmarks.conformance_manifest import MF, entries, file_of
from semmap.language.error import QueryError
from semmap.language.parser import parse_sparql

__all__ = ["READERS", "SyntaxCase", "is_read", "syntax_cases"]

READ = {MF.PositiveSyntaxTest, MF.PositiveSyntaxTest11, MF.PositiveUpdateSyntaxTest11}
REFUSED = {MF.NegativeSyntaxTest, MF.NegativeSyntaxTest11, MF.NegativeUpdateSyntaxTest11}
UPDATES = {MF.PositiveUpdateSyntaxTest11, MF.NegativeUpdateSyntaxTest11}


@dataclass(frozen=True)
class SyntaxCase:
    """A text, and whether it is SPARQL.

    Attributes
    ----------
    group, name : the folder of the manifest, and the name of the test in it
    request : the file with the query or update
    is_update : which of them it is
    is_sparql : False for a text that is to be refused
    """

    group: str
    name: str
    request: Path
    is_update: bool
    is_sparql: bool

    @property
    def key(self) -> str:
        """The group and the name."""
        return f"{self.group}/{self.name}"

    @property
    def text(self) -> str:
        """The query or update."""
        return self.request.read_text(encoding="utf-8")


def syntax_cases(folder: Path) -> Iterator[SyntaxCase]:
    """Yield the syntax tests of all manifests below a folder."""
    for manifest, test, path in entries(folder, READ | REFUSED):
        kinds = set(manifest.objects(test, RDF.type))
        yield SyntaxCase(
            path.parent.name,
            str(test).rsplit("#", 1)[-1],
            file_of(manifest.value(test, MF.action)),
            bool(kinds & UPDATES),
            bool(kinds & READ),
        )


def is_read(case: SyntaxCase, reader: Callable[[SyntaxCase], str]) -> str:
    """Return "" where a reader reads what is SPARQL and refuses the rest, else what is wrong."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        refusal = reader(case)
    if case.is_sparql:
        return refusal
    return "" if refusal else "a text is read that is not SPARQL"


def _by_semmap(case: SyntaxCase) -> str:
    try:
        parse_sparql(case.text, "update" if case.is_update else "query")
    except QueryError as error:
        return error.reason
    return ""


def _by_rdflib(case: SyntaxCase) -> str:
    logging.getLogger("rdflib.term").setLevel(logging.CRITICAL)
    try:
        (prepareUpdate if case.is_update else prepareQuery)(case.text)
    except Exception as error:  # rdflib raises anything on texts that it cannot read
        return f"{type(error).__name__}: {str(error)[:80]}"
    return ""


def _by_oxigraph(case: SyntaxCase) -> str:
    store = pyoxigraph.Store()
    evaluate = store.update if case.is_update else store.query
    try:  # it evaluates what it reads: LOAD and SERVICE must not lead to other servers
        evaluate(case.text.replace("http:", "none:"), base_iri=case.request.as_uri())
    except SyntaxError as error:
        return str(error)
    except (OSError, RuntimeError, ValueError):
        return ""
    return ""


READERS: Mapping[str, Callable[[SyntaxCase], str]] = {
    "semmap": _by_semmap,
    "rdflib": _by_rdflib,
    "oxigraph": _by_oxigraph,
}
