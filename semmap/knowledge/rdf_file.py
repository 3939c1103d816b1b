"""RDF files: Turtle, JSON-LD, TriG, N-Triples, N-Quads and RDF/XML."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pyoxigraph
import rdflib

from semmap.ingest.text_file import read_text
from semmap.ingest.world import WorldError
from semmap.knowledge.facts import Fact, FactWriter, RefusedError, with_consequences
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import INFERRED_GRAPH, TRIPLES
from semmap.knowledge.queries import limited
from semmap.knowledge.rdf_unfolding import refuse_unfolding
from semmap.knowledge.shacl import BrokenShapeError
from semmap.knowledge.sparql.kept_queries import Session
from semmap.knowledge.vocabulary import XSD
from semmap.knowledge.whole_graph import RDF_FORMATS, facts_of
from semmap.limits import ELEMENTS, RDF_CHARACTERS, TEXT_BYTES

FORMATS = {
    ".ttl": "turtle",
    ".jsonld": "json-ld",
    ".trig": "trig",
    ".nt": "nt",
    ".nq": "nquads",
    ".rdf": "xml",
    ".owl": "xml",
}
"""Endings of files, with rdflib's names of their formats."""

_STRING = f"{XSD}string"
_KEPT = 100_000  # terms, each of which is made once
_STEP = 10_000  # facts after which progress is told


def format_of(path: Path) -> str:
    """Return rdflib's name of the format of a file, by its ending; ValueError if it has none."""
    known = FORMATS.get(path.suffix.lower())
    if known is None:
        raise ValueError(f"{path}: the ending {path.suffix!r} is not one of {', '.join(FORMATS)}")
    return known


def read_facts(path: Path, format_: str) -> Iterator[Fact]:
    """Yield the facts of a file, of a format by rdflib's name; or WorldError."""
    yield from _facts_of(read_text(path), format_, path, path.absolute().as_uri())


def parse_facts(text: str, format_: str, source: Path, base: str | None = None) -> list[Fact]:
    """Return the facts of a text; blank nodes are those of the text.

    A relative IRI is resolved by `base`, by default the source, where the text has none.
    """
    return list(_facts_of(text, format_, source, base or source.absolute().as_uri()))


def _facts_of(text: str, format_: str, source: Path, base: str) -> Iterator[Fact]:
    if format_ == "xml":
        _refuse_blow_up(text, source)
    refuse_unfolding(text, format_, source)
    try:
        quads = pyoxigraph.parse(
            text, format=RDF_FORMATS[format_], base_iri=base, rename_blank_nodes=True
        )
        yield from _limited_facts(quads, source)
    except MemoryError as error:  # of pyoxigraph's buffer
        problem = f"has a term that is too long: {error}"
        raise WorldError(source, "file", problem, "Shorten it.") from error
    except (SyntaxError, ValueError, RecursionError) as error:
        raise WorldError(
            source, "file", f"is not {format_}: {str(error)[:300]}", "Fix its syntax."
        ) from error


def _limited_facts(quads: Iterable[Any], source: Path) -> Iterator[Fact]:
    """Yield facts, or refuse them while they are read: short text may stand for much."""
    characters = 0
    most, most_characters = ELEMENTS.value, RDF_CHARACTERS.value
    terms: dict[Any, Any] = {pyoxigraph.DefaultGraph(): None}
    for number, quad in enumerate(quads, 1):
        found = []
        for term in quad:
            if term not in terms:
                terms[term] = _term(term)
            found.append(terms[term])
        fact = Fact(*found)
        characters += len(fact.subject) + len(fact.property) + len(fact.object)
        characters += len(fact.graph or "")
        if number > most or characters > most_characters:
            where = partial(WorldError, source, f"fact {number}")
            ELEMENTS.check(number, where, "Split the file.")
            RDF_CHARACTERS.check(characters, where, "Split the file, or shorten its prefixes.")
        yield fact
        if len(terms) > _KEPT:
            terms = {pyoxigraph.DefaultGraph(): None}


def reported(facts: Iterable[Fact], progress: Callable[[str, int, int], None]) -> Iterator[Fact]:
    """Yield facts, and tell how many there were."""
    for number, fact in enumerate(facts):
        if not number % _STEP:
            progress("facts", number, 0)
        yield fact


_ENTITY = re.compile(r'<!ENTITY\s+[^\s%]+\s+"([^"&]*)"')


def _refuse_blow_up(text: str, source: Path) -> None:
    """Refuse XML whose entities stand for others, or for more than a file may have."""
    values = _ENTITY.findall(text)
    if len(values) < text.count("<!ENTITY"):
        problem = "declares an entity by another one, or from elsewhere"
        raise WorldError(source, "DOCTYPE", problem, "Write out what the entities stand for.")
    grown = max(map(len, values), default=0) * text.count("&")
    where = partial(WorldError, source, "DOCTYPE")
    TEXT_BYTES.check(grown, where, "Write out what the entities stand for.")


def _term(term: Any) -> Any:
    """Return a term of a file as one of rdflib, as it is written there."""
    if isinstance(term, pyoxigraph.NamedNode):
        return rdflib.URIRef(term.value)
    if isinstance(term, pyoxigraph.Literal):
        if term.language:
            return rdflib.Literal(term.value, lang=term.language)
        type_ = term.datatype.value
        if type_ == _STRING:
            return rdflib.Literal(term.value)
        return rdflib.Literal(term.value, datatype=type_, normalize=False)
    if isinstance(term, pyoxigraph.BlankNode):
        return rdflib.BNode(term.value)
    raise ValueError("a triple is the object of another one, which RDF 1.1 does not have")


def store_facts(session: Session, facts: Iterable[Fact], source: Path) -> int:
    """Add facts to the map that a session sees, all or none; return how many were new.

    Inferences (in the graph ``urn:semmap:inferred``) are left out: the map infers its own.
    """

    def implied(found: list[Fact]) -> set[Fact]:
        """Return what the map has: it may follow from other data, which is not stated."""
        named = {str(fact.property) for fact in found}
        mapped = [t for t in TRIPLES if t.property in named or t.name is not None]
        return {Fact(*each) for each in facts_of(session, mapped)}

    with limited(session, None):
        try:
            view = MapView.of(session)
            with with_consequences(view):
                told = (fact for fact in facts if str(fact.graph) != INFERRED_GRAPH)
                return FactWriter(view).insert(told, implied)
        except RefusedError as error:
            raise WorldError(source, error.fact.shown(), error.reason, "Remove it.") from error
        except BrokenShapeError as error:
            raise WorldError(source, "file", str(error), "Correct these facts.") from error
