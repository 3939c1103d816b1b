"""The answer of a query: its terms, and the plain values that they stand for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import rdflib

from semmap.html_table import html_table
from semmap.knowledge.sparql.kept_queries import Row
from semmap.knowledge.vocabulary import decode, map_namespace, prefixes, short


class Explained(str):
    """A part of an explanation, and what it is: "sql", "plan", "fields" or "rdflib"."""

    kind: str

    def __new__(cls, kind: str, text: str) -> Explained:
        """Return the text of a kind."""
        made = super().__new__(cls, text)
        made.kind = kind
        return made


@dataclass(frozen=True)
class Answer:
    """The answer of a query; true if an ASK is, or if there are rows.

    Its rows, in a loop, are tuples of plain values (`plain_value`): of the solutions of a SELECT,
    or of the triples of a CONSTRUCT or DESCRIBE.

    Examples
    --------
    >>> cup = rdflib.URIRef("urn:semmap:map:house#cup1")
    >>> answer = Answer("SELECT", ("x", "mass"), ((cup, rdflib.Literal(0.2)),), map_name="house")
    >>> list(answer), bool(answer)
    ([('cup1', 0.2)], True)
    """

    form: str  # "SELECT", "ASK", "CONSTRUCT" or "DESCRIBE"
    names: tuple[str, ...] = ()  # the variables of a SELECT
    # the solutions of a SELECT as terms; None where a variable is unbound
    rows: tuple[Row, ...] = ()
    truth: bool | None = None  # of an ASK
    graph: rdflib.Graph | None = None  # the triples of a CONSTRUCT or DESCRIBE
    # the fields that were asked, the SQL, its plans, or why rdflib evaluated the query
    explanation: tuple[Explained, ...] = ()
    notes: tuple[str, ...] = ()  # entities without voxels, names that the map does not have
    map_name: str = ""

    def as_json(self) -> bool | dict[str, Any]:
        """The truth of an ASK; else the rows as plain values, and what their columns are."""
        if self.truth is not None:
            return self.truth
        return {"columns": self.names or ("subject", "predicate", "object"), "rows": list(self)}

    def __bool__(self) -> bool:
        """Whether an ASK is true; else, whether there are rows."""
        return bool(self.truth) if self.form == "ASK" else len(self) > 0

    def __len__(self) -> int:
        """The number of solutions or triples."""
        return len(self.rows if self.graph is None else self.graph)

    def __iter__(self) -> Iterator[tuple[Any, ...]]:
        """Iterate over the rows as plain values."""
        for row in self.rows if self.graph is None else self.graph:
            yield tuple(plain_value(term, self.map_name) for term in row)

    def __getitem__(self, index: Any) -> Any:
        """The plain values of a row, or of the rows of a slice."""
        return list(self)[index]

    def _repr_html_(self) -> str:
        if self.form == "ASK":
            return f"<p>{'yes' if self.truth else 'no'}</p>"
        columns = self.names if self.graph is None else ("subject", "property", "object")
        return html_table(columns, list(self))


def plain_value(term: Any, map_name: str) -> Any:
    """Return the name of an entity of the map, a short IRI, or the value of a literal in Python.

    >>> plain_value(rdflib.URIRef("urn:semmap:map:lab#cup%201"), "lab")
    'cup 1'
    >>> plain_value(rdflib.URIRef("urn:semmap:ontology#Cup"), "lab"), plain_value(None, "lab")
    ('semmap:Cup', None)
    """
    if term is None:
        return None
    if isinstance(term, rdflib.Literal):
        value = term.toPython()
        return str(value) if isinstance(value, rdflib.Literal) else value
    if not isinstance(term, rdflib.URIRef):
        return term.n3()
    space = map_namespace(map_name)
    name = decode(str(term)[len(space) :]) if term.startswith(space) else None
    return short(str(term), prefixes(map_name)) if name is None else name
