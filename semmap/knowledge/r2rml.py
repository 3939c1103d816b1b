"""The mapping as a document of R2RML, by which other programs read the database as RDF.

A triples map has the properties of equal rows and subjects. Its terms are columns with IRIs and
lexical forms, not templates: a template keeps letters beyond ASCII, which the IRIs of entities
encode. R2RML has datatypes, languages and graphs as constants: rows of each have a triples map.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from textwrap import fill, indent

from semmap.database.parameters import SETTINGS
from semmap.knowledge.fields.properties import field_properties, is_of_fields
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import (
    COMPUTED,
    DATATYPES,
    INFERENCES_OF_MAP,
    INFERRED_GRAPH,
    JSON_TAGS,
    REWRITTEN,
    STATEMENTS_AS_TEXTS,
    TRIPLES,
)
from semmap.knowledge.sparql.kept_queries import Session
from semmap.knowledge.sparql.values import tag_of, text_of
from semmap.knowledge.triple_map import OWN_LETTERS, TripleMap, TripleTables, Value, constant_iri
from semmap.knowledge.vocabulary import PREFIXES, XSD, graph_iri, short
from semmap.knowledge.whole_graph import graph_of

RR = "http://www.w3.org/ns/r2rml#"
TRIPLES_MAP = "urn:semmap:triples-map:"

_KNOWN = {"rr": RR, "map": TRIPLES_MAP, **PREFIXES}

Tagged = tuple[TripleMap, str]
"""A triple map whose objects have one tag."""


def r2rml(session: Session, *, inferences: bool = False) -> str:
    """Return the mapping of the map that a session sees, in Turtle.

    It is that of all facts which `whole_graph.facts` yields, in their graphs. Comments list the
    properties that it lacks, and why.
    """
    view = MapView.of(session)
    groups: dict[tuple[str, TripleTables, Value], list[Tagged]] = {}
    for triple in (*TRIPLES, *STATEMENTS_AS_TEXTS, *(INFERENCES_OF_MAP if inferences else ())):
        for graph, tag in _constants(view, triple):
            found = _with_constants(triple, graph, tag)
            groups.setdefault((graph, found.source, found.subject), []).append((found, tag))
    maps = [
        _triples_map(view, f"map:{source.tables[0].partition('(')[0]}_{number}", graph, group)
        for number, ((graph, source, _), group) in enumerate(groups.items(), 1)
    ]
    text = "\n".join(maps)
    used = (f"@prefix {name}: <{iri}> .\n" for name, iri in _KNOWN.items() if f"{name}:" in text)
    return f"{_about(view, inferences)}\n{''.join(used)}\n{text}"


def _constants(view: MapView, triple: TripleMap) -> Iterable[tuple[str, str]]:
    """Return the graphs and tags that the facts of a triple map have."""
    if triple in TRIPLES:
        one = DATATYPES.get(triple.object.form, "I")
        return [("", tag) for tag in (JSON_TAGS if triple.object.tag else (one,))]
    tables, where = triple.tables()
    tag = tag_of(triple.object.placed(OWN_LETTERS))
    found = f"SELECT DISTINCT {graph_of(triple)}, {tag} FROM {', '.join(tables)}"
    text = f"{found} WHERE {' AND '.join(where)} ORDER BY 1, 2"
    return view.session.execute(text.encode(), {"map": view.number}).fetchall()


def _with_constants(triple: TripleMap, graph: str, tag: str) -> TripleMap:
    """Return the triple map for the facts of a graph whose objects have a tag."""
    where = list(triple.source.where)
    if triple in STATEMENTS_AS_TEXTS:
        where.append(f"{{a}}.graph = {_formatted(graph)}")
    if triple.object.tag:
        where.append(f"{triple.object.tag} = {_formatted(tag)}")
    return replace(triple, source=replace(triple.source, where=tuple(where)))


def _literal(text: str) -> str:
    """Return a text in SQL without a %, which drivers may take for a parameter."""
    found = text.replace("\\", "\\\\").replace("'", "''").replace("%", "\\x25")
    return f"E'{found}'" if "\\" in found else f"'{found}'"


def _formatted(text: str) -> str:
    """Return the same, for SQL that is formatted."""
    return _literal(text).replace("{", "{{").replace("}", "}}")


def _triples_map(view: MapView, name: str, graph: str, group: list[Tagged]) -> str:
    """Return the triples map of facts with the same rows, subject and graph."""
    first, _ = group[0]
    namespace = _literal(view.namespace)
    columns = {text_of(first.subject.placed(OWN_LETTERS), namespace): "s"}
    properties = []
    for triple, tag in group:
        verb, named = triple.verb(OWN_LETTERS)
        predicate = f"rr:predicate {_turtle(triple.property)}"
        if named is not None:
            column = columns.setdefault(verb, "p")
            predicate = f'rr:predicateMap [ rr:column "{column}" ]'
        object_ = triple.object.placed(OWN_LETTERS)
        iri = constant_iri(object_)
        term = f"rr:object {_turtle(iri or '')}"
        if iri is None:
            text = text_of(object_, namespace)
            column = columns.setdefault(text, f"o{len(columns)}")
            term = f'rr:objectMap [ rr:column "{column}"{_kind(tag)} ]'
        properties.append(f"    rr:predicateObjectMap [ {predicate} ; {term} ]")
    in_graph = f" ; rr:graph {_turtle(graph_iri(graph))}" if graph else ""
    query = _query(view, first, columns).replace("\\", "\\\\").replace('"', '\\"')
    parts = (
        f'    rr:logicalTable [ rr:sqlQuery """{query}""" ]',
        f'    rr:subjectMap [ rr:column "s" ; rr:termType rr:IRI{in_graph} ]',
        *properties,
    )
    return f"{name} a rr:TriplesMap ;\n" + " ;\n".join(parts) + " .\n"


def _query(view: MapView, triple: TripleMap, columns: Mapping[str, str]) -> str:
    """Return the SQL of the rows of a triple map, of columns by their SQL."""
    tables, where = triple.rows()
    selected = ",\n       ".join(f"{text} AS {name}" for text, name in columns.items())
    text = f"SELECT {selected}\nFROM {', '.join(tables)}"
    if where:
        text += f"\nWHERE {' AND '.join(where)}"
    return text.replace("%(map)s", str(view.number))


def _kind(tag: str) -> str:
    """Return the term type, language or datatype of terms with a tag."""
    if tag in ("I", "B"):
        return f" ; rr:termType rr:{'IRI' if tag == 'I' else 'BlankNode'}"
    if tag.startswith("@"):
        return f' ; rr:language "{tag[1:]}"'
    return "" if tag == f"{XSD}string" else f" ; rr:datatype {_turtle(tag)}"


def _turtle(iri: str) -> str:
    """Return an IRI in Turtle."""
    found = short(iri, _KNOWN)
    return found if re.fullmatch(r"[a-z]+:[A-Za-z0-9_]+", found) else f"<{iri}>"


def _about(view: MapView, inferences: bool) -> str:
    """Return comments: how to read the database, and what the document lacks."""
    path = SETTINGS["search_path"]
    lines = [
        f"The map {view.name} as RDF, by R2RML (https://www.w3.org/TR/r2rml/).",
        f"Sessions need the search path {path}: in JDBC ?currentSchema={path}, in libpq "
        f"?options=-csearch_path%3D{path}.",
        "Write it again after statements with new graphs, datatypes or languages, and for another "
        "database.",
        "",
        "Not in this document:",
        *(f"- {names}: {why}" for names, why in _left_out(inferences)),
    ]
    return "".join(
        indent(fill(line, 110, break_on_hyphens=False), "# ", lambda _: True) + "\n"
        for line in lines
    )


def _left_out(inferences: bool) -> Iterator[tuple[str, str]]:
    """Yield properties that no rows of tables have, and why."""
    for each in COMPUTED:
        yield (
            _turtle(each.property),
            f"computed for the entities of a query: {each.decide.format(a='a', b='b')}",
        )
    spatial = dict.fromkeys(_turtle(each.property) for each in REWRITTEN)
    yield ", ".join(spatial), "PostGIS compares the geometries of a query"
    fields = sorted(_turtle(iri) for iri in field_properties() if is_of_fields(iri))
    yield ", ".join(fields), "properties of voxels and entities, which fields compute"
    yield "functions of geof: in filters", "R2RML has no functions"
    if not inferences:
        yield _turtle(INFERRED_GRAPH), "inferences are written with --inferences"
