"""RDF files: Turtle, JSON-LD, TriG, N-Triples and N-Quads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import rdflib

from semmap.ingest.text_file import read_text
from semmap.ingest.world import WorldError
from semmap.knowledge.facts import Fact, FactWriter, RefusedError, with_consequences
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import INFERRED_GRAPH
from semmap.knowledge.queries import limited
from semmap.knowledge.shacl import BrokenShapeError
from semmap.knowledge.sparql.kept_queries import Session
from semmap.knowledge.whole_graph import facts as stored_facts
from semmap.knowledge.whole_graph import without_warnings

FORMATS = {".ttl": "turtle", ".jsonld": "json-ld", ".trig": "trig", ".nt": "nt", ".nq": "nquads"}
"""Endings of files, with rdflib's names of their formats."""


def format_of(path: Path) -> str:
    """Return rdflib's name of the format of a file, by its ending; ValueError if it has none."""
    known = FORMATS.get(path.suffix.lower())
    if known is None:
        raise ValueError(f"{path}: the ending {path.suffix!r} is not one of {', '.join(FORMATS)}")
    return known


def read_facts(path: Path, format_: str) -> list[Fact]:
    """Return the facts of a file, of a format by rdflib's name; or WorldError."""
    return parse_facts(read_text(path), format_, path)


def parse_facts(text: str, format_: str, source: Path) -> list[Fact]:
    """Return the facts of a text; blank nodes are those of the text."""
    if format_ == "json-ld":
        _refuse_remote_context(text, source)
    dataset = rdflib.Dataset()
    try:
        with without_warnings():
            dataset.parse(data=text, format=format_)
            quads = list(dataset.quads())
    except Exception as error:  # rdflib's parsers raise anything on broken text
        raise WorldError(
            source, "file", f"is not {format_}: {str(error)[:300]}", "Fix its syntax."
        ) from error
    default = rdflib.graph.DATASET_DEFAULT_GRAPH_ID
    return [
        Fact(s, p, o, None if graph is None or graph == default else graph)
        for s, p, o, graph in quads
    ]


def _refuse_remote_context(text: str, source: Path) -> None:
    """Refuse JSON-LD whose context is on another server, or in another file."""
    try:
        stack = [json.loads(text)]
    except (ValueError, RecursionError) as error:
        raise WorldError(source, "file", f"is not JSON: {error}", "Fix its syntax.") from error
    while stack:
        part: Any = stack.pop()
        if isinstance(part, dict):
            contexts = part.get("@context", ())
            contexts = contexts if isinstance(contexts, list) else [contexts]
            if any(
                isinstance(c, str) or (isinstance(c, dict) and "@import" in c) for c in contexts
            ):
                raise WorldError(
                    source, "@context", "names another document", "Write the context into the file."
                )
            stack += part.values()
        elif isinstance(part, list):
            stack += part


def _read(term: Any) -> Any:
    """Return a term as rdflib reads it from a file: numbers and times in their usual notation."""
    if isinstance(term, rdflib.Literal) and term.datatype is not None:
        return rdflib.Literal(str(term), datatype=term.datatype)
    return term


def store_facts(session: Session, facts: list[Fact], source: Path) -> int:
    """Add facts to the map that a session sees, all or none; return how many were new.

    Inferences (in the graph ``urn:semmap:inferred``) are left out: the map infers its own.
    """
    with limited(session, None):
        try:
            # What the map has already may follow from other data, which is not stated.
            known = {Fact(s, p, _read(o), g) for s, p, o, g in stored_facts(session)}
            told = (fact for fact in facts if str(fact.graph) != INFERRED_GRAPH)
            new = [fact for fact in told if fact not in known]
            view = MapView.of(session)
            with with_consequences(view):
                return FactWriter(view).insert(new)
        except RefusedError as error:
            raise WorldError(source, error.fact.shown(), error.reason, "Remove it.") from error
        except BrokenShapeError as error:
            raise WorldError(source, "file", str(error), "Correct these facts.") from error
