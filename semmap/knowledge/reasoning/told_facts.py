"""The told facts of a map that rules are about, by the ids of entities."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import STATEMENTS_AS_TEXTS, TRIPLES, WORLD
from semmap.knowledge.reasoning.engine import TYPE_OF, Node, Triple
from semmap.knowledge.reasoning.rules import AXIOM_PROPERTIES
from semmap.knowledge.triple_map import OWN_LETTERS, TripleMap
from semmap.knowledge.vocabulary import SEMMAP, XSD, decode

if TYPE_CHECKING:
    from semmap.knowledge.reasoning.axioms import OntologyAxioms

COLUMNS = "subject_id, subject, predicate, object_id, object, tag"
"""A triple in the tables `statement` and `inference`."""
DIRECT_TYPE = f"{SEMMAP}directType"
KIND = "urn:semmap:reasoning#kind"  # told of an entity whose type does not imply its kind

TOLD: tuple[TripleMap, ...] = tuple(
    triple
    for triple in TRIPLES
    if triple.subject.form == "entity"
    and triple.object.form in ("entity", "iri", "term", "string")
    and triple.source is not WORLD
)
"""The triple maps whose facts rules may be about, besides types and statements: not poses, which
change all the time."""

_SUBJECTS = {"entity": "{}, NULL::text", "iri": "NULL::bigint, {}"}
_OBJECTS = {
    "entity": "{}, NULL::text, NULL::text",
    "iri": "NULL::bigint, {}, 'I'",
    "string": f"NULL::bigint, {{}}, '{XSD}string'",
}


_OF_GRAPH = (
    "a.id IN (SELECT t.id FROM triple t WHERE t.map_id = %(map)s "
    "AND t.graph = CASE WHEN %(graph)s::text = '' THEN 0 ELSE term_id(%(graph)s) END)"
)


@dataclass(frozen=True)
class Hierarchy:
    """The semantic types of the database."""

    digest: str  # changes with them
    supers: Mapping[Node, frozenset[Node]]  # the classes that subsume each class, itself included
    parents: tuple[tuple[Node, Node], ...]  # class and direct superclass

    def of(self, types: Collection[Node]) -> frozenset[Node]:
        """Return all classes of an entity with given types."""
        return frozenset().union(*(self.supers.get(t, frozenset({t})) for t in types))

    def subclasses(self, c: Node) -> list[Node]:
        """Return the classes that a class subsumes."""
        return [sub for sub, supers in self.supers.items() if c in supers] or [c]

    @classmethod
    def read(cls, view: MapView) -> Hierarchy:
        """Return that of the database; kept while it does not change."""
        digest = view.value(
            "SELECT md5((SELECT coalesce(string_agg(name || ' ' || coalesce(iri, ''), ',' "
            "ORDER BY name), '') FROM semantic_type) || (SELECT coalesce(string_agg(type || ' ' || "
            "parent, ',' ORDER BY type, parent), '') FROM type_parent))"
        )
        if _HIERARCHIES.get("last") is None or _HIERARCHIES["last"].digest != digest:
            named = "coalesce({0}.iri, 'urn:semmap:type#' || iri_encode({0}.name))"
            a, b = named.format("a"), named.format("b")
            join = "JOIN semantic_type a ON a.name = {} JOIN semantic_type b ON b.name = {}"
            supers: dict[Node, set[Node]] = {}
            for sub, above in view.session.execute(
                f"SELECT {a}, {b} FROM type_closure c {join.format('c.sub', 'c.super')}"
            ):
                supers.setdefault(sub, set()).add(above)
            parents = view.session.execute(
                f"SELECT {a}, {b} FROM type_parent c {join.format('c.type', 'c.parent')}"
            ).fetchall()
            _HIERARCHIES["last"] = cls(
                digest,
                {sub: frozenset(above) for sub, above in supers.items()},
                tuple((sub, above) for sub, above in parents),
            )
        return _HIERARCHIES["last"]


_HIERARCHIES: dict[str, Hierarchy] = {}


def told_facts(
    view: MapView,
    ontology: OntologyAxioms,
    ids: Collection[int] | None = None,
    *,
    others: bool = True,
) -> Iterator[Triple]:
    """Yield the told facts of a map that rules are about; for types, `DIRECT_TYPE` and `KIND`.

    Of the axioms of a named graph, its statements.

    Only of some entities, as subject or object; also of `others` than entities. Classes are those
    of other vocabularies, such as bot:Space.
    """
    if not ontology.graph:
        yield from _types(view, ontology.hierarchy, ids)
    rules = ontology.rules
    classes = rules.classes | rules.heads
    parts: list[str] = []
    values: dict[str, Any] = {"map": view.number, "ids": None if ids is None else list(ids)}
    values["graph"] = ontology.graph
    for triple in STATEMENTS_AS_TEXTS if ontology.graph else (*TOLD, *STATEMENTS_AS_TEXTS):
        about = triple.subject.form == "entity"
        if not about and not others:
            continue
        if triple.property == TYPE_OF and triple.object.sql[1:].split("'")[0] not in classes:
            continue
        name = f"names{len(parts)}"
        text, names = _select(triple, rules.properties, ids if about else None, name)
        if triple in STATEMENTS_AS_TEXTS:
            text += f" AND {_OF_GRAPH}" * bool(text)
        if text:
            parts.append(text)
            values[name] = names
    if parts:
        with view.session.cursor() as cursor:
            for row in cursor.execute(" UNION ALL ".join(parts).encode(), values):
                yield fact_of(row)


def fact_of(row: Sequence[Any]) -> Triple:
    """Return the triple of a row of `inference`: the columns from `subject_id` to `tag`."""
    subject_id, subject, verb, object_id, text, tag = row
    node: Node = object_id if object_id is not None else text if tag == "I" else (text, tag)
    return (subject if subject_id is None else subject_id), verb, node


def columns_of(fact: Triple) -> tuple[Any, ...]:
    """Return the columns of a triple from `subject_id` to `tag`."""
    subject, verb, node = fact
    left = (subject, None) if isinstance(subject, int) else (None, subject)
    if isinstance(node, int):
        return (*left, verb, node, None, None)
    return (*left, verb, None, *((node, "I") if isinstance(node, str) else node))


def _types(view: MapView, hierarchy: Hierarchy, ids: Collection[int] | None) -> Iterator[Triple]:
    named = "coalesce({0}.iri, 'urn:semmap:type#' || iri_encode({0}.name))"
    chosen = "" if ids is None else " AND e.id = ANY (%(ids)s)"
    rows = view.session.execute(
        f"SELECT e.id, {named.format('t')}, {named.format('k')} FROM entity e "
        "LEFT JOIN semantic_type t ON t.name = e.type JOIN semantic_type k ON k.name = e.kind "
        f"WHERE e.map_id = %(map)s{chosen}".encode(),
        {"map": view.number, "ids": None if ids is None else list(ids)},
    )
    for entity, type_, kind in rows:
        if type_ is not None:
            yield entity, DIRECT_TYPE, type_
        if type_ is None or kind not in hierarchy.supers.get(type_, ()):
            yield entity, KIND, kind


def _select(
    triple: TripleMap,
    properties: frozenset[Node] | None,
    ids: Collection[int] | None,
    parameter: str,
) -> tuple[str, list[str]]:
    """Return the SELECT of a triple map and its names of properties; "" where none is wanted."""
    verb, local = triple.verb(OWN_LETTERS)
    tables, where = triple.tables()
    values: list[str] = []
    if local is not None and properties is not None:
        space = triple.property
        names = [str(p)[len(space) :] for p in properties if str(p).startswith(space)]
        if not names:
            return "", []
        values = sorted(str(decode(n)) for n in names) if space else sorted(names)
        where.append(f"{local} = ANY (%({parameter})s)")
    elif local is not None and not triple.property:
        values = sorted(AXIOM_PROPERTIES)
        where.append(f"{local} <> ALL (%({parameter})s)")
    elif properties is not None and triple.property not in properties:
        return "", []
    subject, object_ = (each.placed(OWN_LETTERS) for each in (triple.subject, triple.object))
    if ids is not None:
        either = [each.sql for each in (subject, object_) if each.form == "entity"]
        where.append(f"({' OR '.join(f'{sql} = ANY (%(ids)s)' for sql in either)})")
    node = f"NULL::bigint, {object_.sql}, {object_.tag}"
    if object_.form != "term":
        node = _OBJECTS[object_.form].format(object_.sql)
    columns = ", ".join((_SUBJECTS[subject.form].format(subject.sql), verb, node))
    return f"SELECT {columns} FROM {', '.join(tables)} WHERE {' AND '.join(where)}", values
