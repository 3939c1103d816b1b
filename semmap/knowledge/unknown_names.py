"""Names of a query that are unknown: an empty answer may come from a misspelling."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Any

from rdflib import URIRef, Variable
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.knowledge.fields.properties import field_properties
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import COMPUTED, DATATYPES, REWRITTEN, SERIALIZATIONS, TRIPLES
from semmap.knowledge.sparql.constants import Constants, iris_in, literals_in
from semmap.knowledge.sparql.expressions import CASTS
from semmap.knowledge.sparql.geosparql import FUNCTIONS
from semmap.knowledge.vocabulary import GEO, GEOF, SEMMAP, TYPE, decode
from semmap.language.syntax_tree import nodes_in
from semmap.suggestions import suggestion

_STATED = (
    "SELECT n FROM unnest(%(iris)s::text[]) n WHERE EXISTS (SELECT FROM triple s "
    "WHERE s.map_id = %(map)s AND term_id(n) IN (s.subject, s.predicate, s.object, s.graph))"
)
_RELATIONS = frozenset(triple.property for triple in REWRITTEN)
_SYSTEM = re.compile(r"""^\s*<([^>]*)>|srsName\s*=\s*["']([^"']*)["']""")
_UNREAD = "SELECT n FROM unnest(%s::text[]) n WHERE (reference_system(n)).srid IS NULL"
_KINDS = tuple(DATATYPES[form] for form in ("geometry", "gml", "geojson"))
_PLACED = (
    "SELECT bool_or(is_on_earth(t.text, t.tag)), bool_and(is_on_earth(t.text, t.tag)) "
    "FROM triple s JOIN term t ON t.id = s.object "
    f"WHERE s.map_id = %s AND t.tag IN {_KINDS} AND EXISTS (SELECT FROM term u "
    f"WHERE u.tag IN {_KINDS} AND is_on_earth(u.text, u.tag))"
)
_HAS_GEOREFERENCE = "SELECT on_earth('POINT(0 0)'::geometry, %s) IS NOT NULL"
_SHAPES = frozenset({*SERIALIZATIONS, f"{GEO}hasSerialization"})
_ENTITIES = "SELECT name FROM entity WHERE map_id = %s"
_TYPES = "SELECT name FROM semantic_type"
_CLASSES = "SELECT iri FROM semantic_type WHERE iri IS NOT NULL"


def unknown_names(view: MapView, constants: Constants, *trees: Any) -> list[str]:
    """Return a sentence for each of our names in a query that no entity, type or property has."""
    own = (SEMMAP, TYPE, view.namespace)
    missing = {
        iri
        for iri in iris_in(trees)
        if iri.startswith(own) and constants.node(iri)[0] == "iri" and iri not in _mapped()
    }
    if missing:
        values = {"iris": sorted(missing), "map": view.number}
        missing -= {row[0] for row in view.session.execute(_STATED, values)}
    systems = sorted({*_systems(trees)})
    unread = view.session.execute(_UNREAD, [systems]).fetchall() if systems else ()
    sentences = [f"there is no geometry in <{iri}>: its axes are not known" for (iri,) in unread]
    sentences += [_sentence(view, iri) for iri in sorted(missing) if not _is_value(view, iri)]
    sentences += _unplaced(view, {*map(str, nodes_in(trees))}, bool(systems))
    called = {str(n.iri) for n in nodes_in(trees) if getattr(n, "name", "") == "Function"}
    return sentences + [
        _of_function(iri) for iri in sorted(called - FUNCTIONS.keys() - CASTS.keys())
    ]


def _systems(trees: Any) -> Iterator[str]:
    """Yield the reference systems that literals and transformations of a query name."""
    shapes = (DATATYPES["geometry"], DATATYPES["gml"])
    for text, tag in literals_in(trees):
        if tag in shapes and (named := _SYSTEM.search(text)):
            yield named[1] or named[2]
    for node in nodes_in(trees):
        if getattr(node, "name", "") == "Function" and str(node.iri) == f"{GEOF}transform":
            yield from (str(each) for each in node.expr[1:] if isinstance(each, URIRef))


def _unplaced(view: MapView, names: set[str], has_systems: bool) -> Iterator[str]:
    """Yield which pairs of the map's frame and of the earth a query does not compare."""
    asks = not _RELATIONS.isdisjoint(names)
    stated = view.session.execute(_PLACED.encode(), [view.number]).fetchone() if asks else None
    some, every = stated or (False, False)
    if some or (has_systems and not _SHAPES.isdisjoint(names)):
        row = view.session.execute(_HAS_GEOREFERENCE.encode(), [view.number]).fetchone()
        if row and not row[0]:
            yield (
                "the map has no georeference in metres (docs/import.md): its geometries are not "
                "compared with those in a reference system"
            )
    if some and not every:
        yield (
            "foreign geometries in the map's frame are not compared with foreign ones in a "
            "reference system: use functions of geof: for them"
        )


def _of_function(iri: str) -> str:
    names = [function.name for function in FUNCTIONS.values()]
    name = iri.replace(GEOF, "geof:").replace(SEMMAP, "semmap:")
    return f"there is no function {name}, so that it has no value{suggestion(name, names)}"


def _is_value(view: MapView, iri: str) -> bool:
    """Return whether a table has a word that is shown as this IRI, such as a function."""
    if not iri.startswith(SEMMAP):
        return False
    pattern = CompValue("BGP", triples=[(Variable("s"), Variable("p"), URIRef(iri))])
    asked = len(view.statements)
    found = view.run(view.statement(pattern, ["s"], limit=1))
    del view.statements[asked:]  # is no part of the answer's explanation
    return bool(found)


def _sentence(view: MapView, iri: str) -> str:
    def column(sql: str, *values: int) -> Iterator[str]:
        return (row[0] for row in view.session.execute(sql.encode(), values))

    local = iri.partition("#")[2]
    if iri.startswith(SEMMAP):
        names = (i.removeprefix(SEMMAP) for i in (*_mapped(), *column(_CLASSES)))
        close = suggestion(local, names, "docs/knowledge.md lists them")
        return f"semmap:{local} is neither a class nor a property{close}"
    name = decode(local) or local
    if iri.startswith(TYPE):
        return f"there is no type {name}{suggestion(name, column(_TYPES))}"
    return f"the map has no entity {name}{suggestion(name, column(_ENTITIES, view.number))}"


@cache
def _mapped() -> frozenset[str]:
    """Return the properties, functions and classes of `SEMMAP` that are no types of entities."""
    columns = "".join(t.subject.sql + t.object.sql for t in TRIPLES)
    return frozenset(
        iri
        for iri in (
            *(t.property for t in (*TRIPLES, *REWRITTEN)),
            *(c.property for c in COMPUTED),
            *FUNCTIONS,
            *field_properties(),
            *re.findall(rf"'({SEMMAP}\w+)'", columns),
        )
        if iri.startswith(SEMMAP)
    )
