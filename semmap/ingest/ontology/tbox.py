"""The T-Box: semantic types and what subsumes them, from ontologies in Turtle."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from rdflib import OWL, RDF, RDFS, SKOS, Graph, Literal, URIRef
from rdflib.plugins.parsers.notation3 import BadSyntax

from semmap.ingest.text_file import read_text
from semmap.ingest.world import WorldError
from semmap.snake_case import local_name, namespace_of, snake_case

ENDINGS = (".ttl", ".nt")
"""Endings of Turtle, and of N-Triples, which is a part of Turtle."""

TYPICAL_SIZE = URIRef("urn:semmap:ontology#typicalSize")
FOUND_IN = URIRef("urn:semmap:ontology#foundIn")
KEEPS = URIRef("urn:semmap:ontology#keeps")
USED_FOR = URIRef("urn:semmap:ontology#usedFor")
FUNCTION = URIRef("urn:semmap:ontology#Function")

KINDS = ("room", "object", "region", "connector", "elevator", "storey", "agent")
"""The types that are kinds of entity; each subtype is for entities of that kind."""


@dataclass(frozen=True)
class TypeRecord:
    """A semantic type (Deeken et al., section 3.3, A2).

    `kind` is one of `KINDS`, None for none or several; the typical size is depth (along its front),
    width and height, metres; `found_in` has types of places. `keeps` says how readily things are
    kept there, per area, to a table's; None: as its supertype.
    """

    name: str  # local name of the class in lower snake case
    label: str
    iri: str
    parents: tuple[str, ...]  # types that subsume it directly
    kind: str | None
    comment: str | None
    synonyms: tuple[str, ...] = ()
    typical_size: tuple[float, float, float] | None = None
    found_in: tuple[str, ...] = ()
    functions: tuple[str, ...] = ()  # what such things are used for, such as drinking
    keeps: float | None = None


def ontology_files() -> list[Path]:
    """Return the files of the T-Box: in the installed package, or beside it in a source tree."""
    package = Path(__file__).resolve().parents[2]
    folders = (package / "_data" / "schema" / "ontology", package.parent / "schema" / "ontology")
    return sorted(next((f for f in folders if f.is_dir()), folders[0]).glob("*.ttl"))


@cache
def own_tbox() -> tuple[TypeRecord, ...]:
    """Return the classes of `ontology_files`; a process reads them once."""
    return tuple(read_tbox(ontology_files()))


def read_tbox(paths: Iterable[Path]) -> list[TypeRecord]:
    """Return the classes of ontology files, which may refer to each other, each after its parents.

    Classes are declared as ``rdfs:Class`` or ``owl:Class``. A superclass of another namespace that
    no file declares is left out. A WorldError refuses two classes of one name, references to what
    is not declared, and classes that subsume each other.
    """
    graph = Graph()
    path_of: dict[URIRef, Path] = {}  # several files may describe one class: the first of them
    sizes: dict[URIRef, tuple[float, float, float]] = {}
    shares: dict[URIRef, float] = {}
    for path in paths:
        part = _parse(path)
        for iri in sorted(_subjects(part, RDFS.Class) | _subjects(part, OWL.Class)):
            path_of.setdefault(iri, path)
            if (size := _text(part, iri, TYPICAL_SIZE)) is not None:
                sizes[iri] = _size(size, path, iri)
            if (share := _text(part, iri, KEEPS)) is not None:
                shares[iri] = _share(share, path, iri)
        graph += part
    names, functions = _names(path_of), _subjects(graph, FUNCTION)
    for iri, path in path_of.items():
        _check_references(graph, iri, path, names, functions)
    parents = {
        name: sorted(names[p] for p in _references(graph, iri, RDFS.subClassOf) if p in names)
        for iri, name in names.items()
    }
    iri_of = {name: iri for iri, name in names.items()}
    records: dict[str, TypeRecord] = {}
    kinds: dict[str, frozenset[str]] = {}
    for name in _parents_first(parents, {n: path_of[i] for n, i in iri_of.items()}):
        iri = iri_of[name]
        kinds[name] = frozenset({name} & set(KINDS)).union(*(kinds[p] for p in parents[name]))
        records[name] = TypeRecord(
            name=name,
            label=_text(graph, iri, RDFS.label) or name.replace("_", " "),
            iri=str(iri),
            parents=tuple(parents[name]),
            kind=next(iter(kinds[name])) if len(kinds[name]) == 1 else None,
            comment=_text(graph, iri, RDFS.comment),
            synonyms=tuple(sorted(map(str, graph.objects(iri, SKOS.altLabel)))),
            typical_size=sizes.get(iri),
            found_in=tuple(sorted(names[place] for place in _references(graph, iri, FOUND_IN))),
            functions=tuple(
                sorted(snake_case(local_name(f)) for f in _references(graph, iri, USED_FOR))
            ),
            keeps=shares.get(iri),
        )
    return list(records.values())


def _parse(path: Path) -> Graph:
    if path.suffix.lower() not in ENDINGS:
        problem = f"{path.suffix!r} is not the ending of an ontology"
        raise WorldError(path, "ending", problem, f"Known: {', '.join(ENDINGS)}.")
    text = read_text(path)
    try:
        return Graph().parse(data=text, format="turtle")
    except BadSyntax as error:
        where, problem = f"line {error.lines + 1}", f"is not Turtle: {error.message}"
        raise WorldError(path, where, problem, "Correct the syntax there.") from error
    except Exception as error:  # rdflib's parsers raise anything, assertions too, on broken text
        problem = f"is not Turtle: {str(error)[:200]}"
        fix = "It may be truncated: restore it, or fix its syntax."
        raise WorldError(path, "file", problem, fix) from error


def _subjects(graph: Graph, class_: URIRef) -> set[URIRef]:
    return {s for s in graph.subjects(RDF.type, class_) if isinstance(s, URIRef)}


def _references(graph: Graph, iri: URIRef, predicate: URIRef) -> set[URIRef]:
    return {o for o in graph.objects(iri, predicate) if isinstance(o, URIRef)}


def _text(graph: Graph, iri: URIRef, predicate: URIRef) -> str | None:
    """Return a text of a class, in English if it has several languages."""
    texts = [o for o in graph.objects(iri, predicate) if isinstance(o, Literal)]
    texts.sort(key=lambda t: (not (t.language or "en").startswith("en"), t.language or "", str(t)))
    return str(texts[0]) if texts else None


def _size(text: str, path: Path, iri: URIRef) -> tuple[float, float, float]:
    with suppress(ValueError):
        depth, width, height = (float(word) for word in text.split())
        if all(0 < length < math.inf for length in (depth, width, height)):
            return depth, width, height
    fix = 'Give depth, width and height in metres, such as "0.8 1.2 0.75".'
    raise WorldError(path, f"class <{iri}>", f"its typical size is {text!r}", fix)


def _share(text: str, path: Path, iri: URIRef) -> float:
    share = float(text) if text.replace(".", "", 1).isdecimal() else math.nan
    if 0 < share < math.inf:
        return share
    fix = "Give a number above 0: 1 is that of a table."
    raise WorldError(path, f"class <{iri}>", f"it keeps {text!r}", fix)


def _names(path_of: dict[URIRef, Path]) -> dict[URIRef, str]:
    iri_of: dict[str, URIRef] = {}
    for iri, path in path_of.items():
        name, where = snake_case(local_name(iri)), f"class <{iri}>"
        if not name:
            raise WorldError(path, where, "has no local name", "Give it one.")
        if name in iri_of:
            problem = f"is named {name}, as is <{iri_of[name]}>"
            raise WorldError(path, where, problem, "Rename one.")
        iri_of[name] = iri
    return {iri: name for name, iri in iri_of.items()}


def _check_references(
    graph: Graph,
    iri: URIRef,
    path: Path,
    classes: Collection[URIRef],
    functions: Collection[URIRef],
) -> None:
    """Refuse a class that names what no file declares."""
    parents = _references(graph, iri, RDFS.subClassOf)
    parents = {p for p in parents if namespace_of(p) == namespace_of(iri)}
    places, uses = (_references(graph, iri, p) for p in (FOUND_IN, USED_FOR))
    for what, named, declared, kind in (
        ("its superclass <{}> is", parents, classes, "a owl:Class"),
        ("it is found in <{}>, which is", places, classes, "a owl:Class"),
        ("it is used for <{}>, which is", uses, functions, "a :Function"),
    ):
        for missing in sorted(named.difference(declared)):
            problem = f"{what.format(missing)} declared in none of the files"
            fix = f"Declare it ({kind}), correct its name, or give the file that declares it."
            raise WorldError(path, f"class <{iri}>", problem, fix)


def _parents_first(parents: dict[str, list[str]], path_of: dict[str, Path]) -> list[str]:
    try:
        return list(TopologicalSorter({n: parents[n] for n in sorted(parents)}).static_order())
    except CycleError as error:
        cycle = error.args[1]
        problem = f"subsumes itself: {' > '.join(cycle)}"
        fix = "Remove one of these rdfs:subClassOf statements."
        raise WorldError(path_of[cycle[0]], f"class {cycle[0]}", problem, fix) from error
