"""The constants of a query: which IRIs are entities, types or other nodes of the map."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import psycopg
import rdflib

from semmap.knowledge.mapping import (
    COMPUTED,
    NODES,
    REWRITTEN,
    SERIALIZATIONS,
    SHAPE_PROPERTIES,
    TRIPLES,
    is_mapped,
)
from semmap.knowledge.triple_map import Form
from semmap.knowledge.vocabulary import KNOWLEDGE_CORE, RDF, SEMMAP, TYPE, XSD, decode, encode
from semmap.language.syntax_tree import nodes_in
from semmap.snake_case import local_name, namespace_of, snake_case

_OWN = {t.property for t in TRIPLES} | {c.property for c in COMPUTED}
_REWRITTEN = {t.property for t in REWRITTEN}
_KEY = re.compile(r"[0-9]{1,18}(\.[0-9]{1,18})?")

_VOXEL = re.compile(r"-?[0-9]{1,7}(,-?[0-9]{1,7}){2}")
_UUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")


@lru_cache(maxsize=10_000)
def _own_property(iri: str) -> str:
    if namespace_of(iri) in KNOWLEDGE_CORE:
        own = (space + local_name(iri) for space in (KNOWLEDGE_CORE[0], SEMMAP))
        return next((each for each in own if each in _OWN), iri)
    return iri


@dataclass(frozen=True, eq=False)
class Constants:
    """What the IRIs of a text stand for."""

    known: Mapping[str, tuple[Form, Any]]  # form and key of those that are nodes of the map
    # the types of those that may stand for an entity, too
    types_of: Mapping[str, str] = field(default_factory=dict)
    classes: Mapping[str, str] = field(default_factory=dict)  # the IRI of each type in its ontology
    stated: frozenset[str] | None = None  # the properties of statements; None: any
    # the properties and classes of the map that statements about foreign resources have
    foreign: Set[str] = frozenset()
    # by text and tag, the numbers of terms that statements have; None where none was looked up
    terms: Mapping[tuple[str, str], int] | None = None

    @property
    def key(self) -> tuple[Any, ...]:
        """What tells these constants from others."""
        parts = (self.known, self.types_of, self.classes, self.terms or {})
        of_each = (frozenset(each.items()) for each in parts)
        return (*of_each, self.stated, frozenset(self.foreign))

    def node(self, iri: str, *, as_type: bool = False) -> tuple[Form, Any]:
        """Return form and key of an IRI, of a type if `as_type`; of no node, the IRI itself."""
        if iri in self.types_of and (as_type or iri not in self.known):
            return "type", self.types_of[iri]
        return self.known.get(iri, ("iri", iri))

    def only(self, iris: Iterable[str]) -> Constants:
        """Return the constants of some IRIs."""
        wanted = set(iris)
        return Constants(
            {iri: self.known[iri] for iri in wanted & self.known.keys()},
            {iri: self.types_of[iri] for iri in wanted & self.types_of.keys()},
            dict(self.classes),
            foreign=frozenset(self.foreign),
            terms=self.terms,
        )

    def class_of(self, type_: str) -> str:
        """Return the IRI of a type that an IRI of the text stands for."""
        return self.classes.get(type_) or f"{TYPE}{encode(type_)}"

    def types(self) -> frozenset[str]:
        """Return the names of the types that IRIs of the text stand for."""
        known = {key for form, key in self.known.values() if form == "type"}
        return frozenset(known | set(self.types_of.values()))

    def with_entity(self, iri: str, number: int) -> Constants:
        """Return these constants, and one more for a new entity."""
        return replace(self, known={**self.known, iri: ("entity", number)})

    def is_stated(self, iri: str) -> bool:
        """Return whether statements may have a property of the text."""
        return self.stated is None or iri in self.stated

    def is_foreign(self, iri: str) -> bool:
        """Return whether statements about foreign resources have this property or class."""
        return self.stated_as(iri) in self.foreign

    def stated_as(self, iri: str) -> str:
        """Return the IRI that statements have of a property or class."""
        form, key = self.node(iri, as_type=True)
        return self.class_of(key) if form == "type" else self.property(iri)

    def property(self, iri: str) -> str:
        """Return the property that an IRI of KnowledgeCore's namespaces stands for, else itself."""
        return _own_property(iri)


_NODES = (
    "SELECT 'entity', name, id::text, NULL FROM entity "
    "WHERE map_id = %(map)s::int AND name = ANY (%(names)s::text[])",
    "SELECT 'type', iri, name, NULL FROM semantic_type WHERE iri = ANY (%(iris)s::text[])",
    "SELECT 'name', iri, name, NULL FROM semantic_type WHERE name = ANY (%(types)s::text[])",
    "SELECT 'stated', p, NULL, NULL FROM unnest(%(properties)s::text[]) p WHERE EXISTS "
    "(SELECT FROM triple s WHERE s.map_id = %(map)s::int AND s.predicate = term_id(p))",
    "SELECT 'foreign', p, NULL, NULL FROM unnest(%(mapped)s::text[]) p WHERE EXISTS (SELECT FROM "
    "triple s WHERE s.map_id = %(map)s::int AND s.predicate = term_id(p) AND s.graph = 0)",
    "SELECT 'foreign', type_iri(t.name), NULL, NULL FROM semantic_type t WHERE "
    "(t.iri = ANY (%(iris)s::text[]) OR t.name = ANY (%(types)s::text[])) AND EXISTS (SELECT FROM "
    f"triple s WHERE s.map_id = %(map)s::int AND s.predicate = term_id('{RDF}type') "
    "AND s.graph = 0 AND s.object = term_id(type_iri(t.name)) AND s.subject < 0)",
    "SELECT 'term', t.text, t.id::text, t.tag FROM unnest(%(texts)s::text[], %(tags)s::text[]) "
    "n (text, tag) JOIN term t "
    "ON md5(t.text)::uuid = md5(n.text)::uuid AND t.tag = n.tag AND t.text = n.text",
)

Found = tuple[str | None, ...]  # what a statement of `Lookup` finds: a kind, and three texts


class Lookup:
    """What terms of a text may stand for, and the statement that looks them up in a `map`."""

    def __init__(
        self, iris: Iterable[str], namespace: str, literals: Iterable[tuple[str, str]] = ()
    ) -> None:
        self._known: dict[str, tuple[Form, Any]] = {}
        self._names: dict[str, list[tuple[str, Form]]] = {}
        self._types: dict[str, list[str]] = {}
        self._keyed: dict[Form, dict[str, str]] = {}
        self._iris = frozenset(iris)
        for iri in self._iris:
            self._add(iri, namespace)
        parts = list(_NODES)
        properties = sorted({*map(Constants({}).property, self._iris)})
        self.parameters: dict[str, Any] = {
            "names": sorted(self._names),
            "iris": sorted(self._iris),
            "types": sorted(self._types),
            "properties": [p for p in properties if p in SERIALIZATIONS or not is_mapped(p)],
            "mapped": [each for each in properties if is_mapped(each)],
        }
        resources = self._iris.union(properties)
        terms = sorted({*((iri, "I") for iri in resources), *literals})
        self.parameters["texts"] = [text for text, _ in terms]
        self.parameters["tags"] = [tag for _, tag in terms]
        for form, keys in self._keyed.items():
            table, column, type_ = NODES[form].keyed or ("", "", "")
            self.parameters[form] = sorted(
                key for key in keys if type_ != "uuid" or _UUID.fullmatch(key)
            )
            parts.append(
                f"SELECT '{form}', {column}::text, id::text, NULL FROM {table} "
                f"WHERE {column} = ANY (%({form})s::text[]::{type_}[])"
            )
        self.sql = " UNION ALL ".join(parts)

    def _add(self, iri: str, namespace: str) -> None:
        local = local_name(iri)
        if iri.startswith(namespace):
            form, name = _node_of_map(iri[len(namespace) :])
            if name is not None:
                self._names.setdefault(name, []).append((iri, form))
        elif namespace_of(iri) in KNOWLEDGE_CORE and local:
            self._names.setdefault(local, []).append((iri, "entity"))
            self._types.setdefault(snake_case(local), []).append(iri)
        elif iri.startswith(TYPE):
            self._types.setdefault(decode(iri[len(TYPE) :]) or "", []).append(iri)
        else:
            for form, node in NODES.items():
                key = iri.removeprefix(node.prefix) if node.prefix and not node.of_map else iri
                if key != iri and node.keyed:
                    self._keyed.setdefault(form, {})[decode(key) or ""] = iri
                elif key != iri and form == "voxel" and _VOXEL.fullmatch(key):
                    self._known[iri] = (form, key)
                elif key != iri and _KEY.fullmatch(key):
                    self._known[iri] = (form, key if form == "former" else int(key))

    def constants(self, rows: Iterable[Found]) -> Constants:
        """Return the constants that the rows of the statement state."""
        known = dict(self._known)
        types: dict[str, str] = {}
        classes: dict[str, str] = {}
        texts = [(kind, found, key or "") for kind, found, key, _ in rows]
        for kind, found, key in texts:
            if kind in ("type", "name") and found is not None:
                classes[key] = found
            if kind == "type" and found is not None:
                known[found] = ("type", key)
            if kind == "name":
                types |= dict.fromkeys(self._types[key], key)
        for kind, found, key in texts:
            if kind == "entity":
                for iri, form in self._names[found or ""]:
                    known.setdefault(iri, (form, int(key)))
            elif kind in self._keyed:
                known[self._keyed[kind or ""][found or ""]] = (kind or "", int(key))
        stated, foreign = (
            frozenset(found or "" for kind, found, _ in texts if kind == wanted)
            for wanted in ("stated", "foreign")
        )
        terms = {(text or "", tag or ""): int(n or 0) for of, text, n, tag in rows if of == "term"}
        return Constants(known, types, classes, stated, foreign, terms)


def resolve(
    session: psycopg.Connection[Any], iris: Iterable[str], namespace: str, map_id: int
) -> Constants:
    """Look up what the IRIs of a text stand for, in one statement."""
    lookup = Lookup(iris, namespace)
    parameters = {**lookup.parameters, "map": map_id}
    return lookup.constants(session.execute(lookup.sql.encode(), parameters).fetchall())


def _node_of_map(part: str) -> tuple[Form, str | None]:
    for form, node in NODES.items():
        if node.of_map and node.prefix and part.startswith(node.prefix):
            return form, decode(part[len(node.prefix) :])
    return "entity", decode(part)


def iris_in(tree: Any) -> Iterator[str]:
    """Yield the IRIs of a part of the algebra, and the properties that decide relations of them."""
    for each in nodes_in(tree):
        if isinstance(each, rdflib.URIRef):
            yield str(each)
            if str(each) in _REWRITTEN:
                yield from SHAPE_PROPERTIES


def literals_in(tree: Any) -> Iterator[tuple[str, str]]:
    """Yield text and tag of the literals of a part of the algebra."""
    return (tag_and_text(each) for each in nodes_in(tree) if isinstance(each, rdflib.Literal))


def tag_and_text(term: Any) -> tuple[str, str]:
    """Return the text and the tag of an rdflib term."""
    if isinstance(term, rdflib.Literal):
        if term.language:
            return str(term), f"@{term.language.lower()}"
        return str(term), str(term.datatype or f"{XSD}string")
    return str(term), "B" if isinstance(term, rdflib.BNode) else "I"
