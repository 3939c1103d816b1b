"""Why the map fails tests of the W3C."""

from __future__ import annotations

__all__ = ["FAILURES", "why"]

_BEFORE_RDF_11 = "the test is older than RDF 1.1, where a text without a language is an xsd:string"
_BLANK = "blank nodes of stored statements have IRIs (RDF 1.1, section 3.5), so that they are IRIs"
_LEAVES = "is refused: a query does not leave the database"

FAILURES: dict[str, str] = {
    # SPARQL 1.1
    "entailment": "queries see stated facts and types with all that subsume them; other entailment "
    "regimes are not evaluated when a query runs",
    "aggregates/agg-empty-group": "without solutions, GROUP BY a key makes no group (SPARQL 1.1, "
    "section 18.5.1), as in oxigraph; the test expects a row",
    "functions/strdt03": _BEFORE_RDF_11,
    "functions/strlang03": _BEFORE_RDF_11,
    # Texts that are SPARQL and refused on purpose, and one that is not and read
    "syntax-fed": f"SERVICE {_LEAVES}",
    **dict.fromkeys(
        [f"syntax-update-1/test_{number}" for number in (1, 2, 3, 4, 37)],
        f"LOAD {_LEAVES}; with SILENT it does nothing",
    ),
    "syntax-update-2/syntax-update-other-01": "a text has at most 2,500 words, unless "
    "SEMMAP_MAX_QUERY_WORDS is higher; this has 2,501",
    "syntax-sparql3/syn-bad-26": "?x<?a&&?b>?y is read as two comparisons, as in oxigraph; the "
    "test has an IRI between two variables, which can have no meaning there",
    # The protocol
    "protocol/update_base_uri": "an endpoint may define a base IRI; this has none, so that IRIs "
    "are relative to BASE of the text alone",
    # The graph store
    **dict.fromkeys(
        ["graph-store/put__default_graph", "graph-store/get_of_put__default_graph"],
        "the default graph is the map, which is not replaced",
    ),
    # SPARQL 1.0
    "dataset/dawg-dataset-09": "FROM and FROM NAMED name one stored graph, which has its blank "
    "nodes once; the test reads a file twice",
    "dataset/dawg-dataset-10": "as dawg-dataset-09",
    "dataset/dawg-dataset-12": "as dawg-dataset-09",
    "distinct/distinct-2": _BEFORE_RDF_11,
    "distinct/distinct-9": _BEFORE_RDF_11,
    "expr-builtin/dawg-isBlank-1": _BLANK,
    "expr-builtin/dawg-isURI-1": _BLANK,
    "expr-builtin/dawg-isIRI-1": _BLANK,
    "open-world/date-1": "a time without a zone is in UTC, the implicit zone of XPath; the test "
    "has none",
}
"""Explanations by group and name of a test, or by a whole group."""


def why(test: str) -> str | None:
    """Return the explanation of a failed test; None where there is none.

    Examples
    --------
    >>> why("functions/strdt03") is not None, why("functions/unknown")
    (True, None)
    """
    return FAILURES.get(test, FAILURES.get(test.split("/")[0]))
