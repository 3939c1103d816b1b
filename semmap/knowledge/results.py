"""Answers as text: SPARQL's result formats, and terms as people read them."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Mapping
from textwrap import indent
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import rdflib
from psycopg import sql

from semmap.database.parameters import SETTINGS
from semmap.knowledge.answer import Answer, Explained
from semmap.knowledge.sparql.kept_queries import PLANNER
from semmap.knowledge.vocabulary import short

_NOT_IN_XML = re.compile(r"[^\t\n\r -\U0010ffff]")


def shown(term: Any, known: Mapping[str, str]) -> str | None:
    """Return a term for a table: an IRI with its prefix, a literal without its datatype."""
    if term is None:
        return None
    if isinstance(term, rdflib.URIRef):
        return short(str(term), known)
    return str(term)


def sparql_json(answer: Answer) -> str:
    """Return SPARQL 1.1 Query Results JSON."""
    if answer.form == "ASK":
        return json.dumps({"head": {}, "boolean": bool(answer.truth)})
    bindings = [
        {n: _json(t) for n, t in zip(answer.names, row, strict=True) if t is not None}
        for row in answer.rows
    ]
    return json.dumps({"head": {"vars": list(answer.names)}, "results": {"bindings": bindings}})


def explained_json(answer: Answer) -> str:
    """Return the parts of an explanation, after the settings of the session."""
    parts = [_settings(answer), *answer.explanation]
    return json.dumps([{"kind": part.kind, "text": part} for part in parts])


def explained_script(answer: Answer) -> str:
    """Return an explanation as a script of psql: all but settings and SQL is in comments."""
    parts = [
        f"{part};" if part.kind in ("settings", "sql") else indent(part, "-- ", lambda _: True)
        for part in (_settings(answer), *answer.explanation)
    ]
    return "\n\n".join(parts)


def _settings(answer: Answer) -> Explained:
    """Return the SQL of a session's settings, by which the answer's SQL finds tables and map."""
    map_name = sql.Literal(answer.map_name).as_string(None)
    values = {**SETTINGS, **PLANNER, "semmap.map": map_name}
    text = ";\n".join(f"SET {name} = {value}" for name, value in values.items())
    return Explained("settings", text)


def event_json(what: str, bindings: Mapping[str, Any]) -> str:
    """Return an event of a standing query as a line, its terms as in `sparql_json`."""
    return json.dumps({"event": what, "bindings": {n: _json(t) for n, t in bindings.items()}})


def _json(term: Any) -> dict[str, str]:
    kind, attributes = _kind(term)
    return {"type": kind, **attributes, "value": str(term)}


def _kind(term: Any) -> tuple[str, dict[str, str]]:
    if isinstance(term, rdflib.URIRef):
        return "uri", {}
    if isinstance(term, rdflib.BNode):
        return "bnode", {}
    if term.language:
        return "literal", {"xml:lang": term.language}
    if term.datatype and term.datatype != rdflib.XSD.string:
        return "literal", {"datatype": str(term.datatype)}
    return "literal", {}


def sparql_xml(answer: Answer) -> str:
    """Return SPARQL Query Results XML."""
    head = "".join(f"<variable name={quoteattr(n)}/>" for n in answer.names)
    if answer.form == "ASK":
        body = f"<boolean>{'true' if answer.truth else 'false'}</boolean>"
    else:
        results = []
        for row in answer.rows:
            cells = []
            for name, term in zip(answer.names, row, strict=True):
                if term is not None:
                    kind, attributes = _kind(term)
                    marks = "".join(f" {k}={quoteattr(v)}" for k, v in attributes.items())
                    text = escape(_NOT_IN_XML.sub("�", str(term)))
                    cells.append(
                        f"<binding name={quoteattr(name)}><{kind}{marks}>{text}</{kind}></binding>"
                    )
            results.append(f"<result>{''.join(cells)}</result>")
        body = f"<results>{''.join(results)}</results>"
    return (
        '<?xml version="1.0"?><sparql xmlns="http://www.w3.org/2005/sparql-results#">'
        f"<head>{head}</head>{body}</sparql>"
    )


def sparql_csv(answer: Answer) -> str:
    """Return SPARQL 1.1 Query Results CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\r\n")
    writer.writerow(answer.names)
    writer.writerows(["" if t is None else str(t) for t in row] for row in answer.rows)
    return text.getvalue()


def sparql_tsv(answer: Answer) -> str:
    """Return SPARQL 1.1 Query Results TSV."""
    lines = ["\t".join(f"?{name}" for name in answer.names)]
    for row in answer.rows:
        lines.append("\t".join("" if t is None else t.n3().replace("\t", "\\t") for t in row))
    return "\n".join(lines) + "\n"


TRUTH_FORMATS = {
    "application/sparql-results+json": sparql_json,
    "application/json": sparql_json,
    "application/sparql-results+xml": sparql_xml,
}
"""Media types of ASK, the default first."""

RESULT_FORMATS = {
    **TRUTH_FORMATS,
    "text/csv": sparql_csv,
    "text/tab-separated-values": sparql_tsv,
}
"""Media types of SELECT, the default first."""
