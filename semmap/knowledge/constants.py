"""The constants of a query: which IRIs are entities, types or other nodes of the map."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import psycopg
import rdflib
from rdflib.paths import Path
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.knowledge.mapping import COMPUTED, NODES, TRIPLES, Form
from semmap.knowledge.vocabulary import KNOWLEDGE_CORE, SEMMAP, TYPE, XSD, decode
from semmap.language.terms import local_name, namespace_of
from semmap.snake_case import snake_case

__all__ = ["Constants", "iris_in", "parts_of", "resolve", "tag_and_text"]

_OWN = {t.property for t in TRIPLES} | {c.property for c in COMPUTED}
_KEY = re.compile(r"[0-9]{1,18}(\.[0-9]{1,18})?")

_VOXEL = re.compile(r"-?[0-9]{1,7}(,-?[0-9]{1,7}){2}")
_UUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")


class Constants:
    """What the IRIs of a text stand for.

    Parameters
    ----------
    known : form and key of each IRI that is a node of the map
    types : the types of IRIs that may stand for an entity, too
    """

    def __init__(
        self, known: Mapping[str, tuple[Form, Any]], types: Mapping[str, str] | None = None
    ) -> None:
        self._known = known
        self._types = types or {}

    @property
    def key(self) -> tuple[Any, ...]:
        """What tells these constants from others."""
        return frozenset(self._known.items()), frozenset(self._types.items())

    def node(self, iri: str, *, as_type: bool = False) -> tuple[Form, Any]:
        """Return the form and the key of an IRI; of an IRI that is not a node, itself.

        Parameters
        ----------
        as_type : a name that both an entity and a type have stands for the type
        """
        if iri in self._types and (as_type or iri not in self._known):
            return "type", self._types[iri]
        return self._known.get(iri, ("iri", iri))

    def only(self, iris: Iterable[str]) -> Constants:
        """Return the constants of some IRIs."""
        wanted = set(iris)
        return Constants(
            {iri: self._known[iri] for iri in wanted & self._known.keys()},
            {iri: self._types[iri] for iri in wanted & self._types.keys()},
        )

    def and_also(
        self, known: Mapping[str, tuple[Form, Any]], types: Mapping[str, str]
    ) -> Constants:
        """Return these constants, and others."""
        return Constants({**self._known, **known}, {**self._types, **types})

    def with_entity(self, iri: str, number: int) -> Constants:
        """Return these constants, and one more for a new entity."""
        return self.and_also({iri: ("entity", number)}, {})

    def property(self, iri: str) -> str:
        """Return the property that an IRI of KnowledgeCore's namespaces stands for, else itself."""
        if namespace_of(iri) in KNOWLEDGE_CORE:
            own = (space + local_name(iri) for space in (KNOWLEDGE_CORE[0], SEMMAP))
            return next((each for each in own if each in _OWN), iri)
        return iri


def resolve(session: psycopg.Connection[Any], iris: Iterable[str], namespace: str) -> Constants:
    """Look up what the IRIs of a text stand for, in one statement.

    Parameters
    ----------
    session : sees the map
    namespace : of the map's entities
    """
    known: dict[str, tuple[Form, Any]] = {}
    either: dict[str, str] = {}
    names: dict[str, list[tuple[str, Form]]] = {}
    classes: dict[str, str] = {}
    types: dict[str, list[str]] = {}
    keyed: dict[Form, dict[str, str]] = {}
    for iri in set(iris):
        local = local_name(iri)
        if iri.startswith(namespace):
            form, name = _node_of_map(iri[len(namespace) :])
            if name is not None:
                names.setdefault(name, []).append((iri, form))
        elif namespace_of(iri) in KNOWLEDGE_CORE and local:
            names.setdefault(local, []).append((iri, "entity"))
            types.setdefault(snake_case(local), []).append(iri)
        elif iri.startswith(TYPE):
            types.setdefault(decode(iri[len(TYPE) :]) or "", []).append(iri)
        else:
            for form, node in NODES.items():
                key = iri.removeprefix(node.prefix) if node.prefix and not node.of_map else iri
                if key != iri and node.keyed:
                    keyed.setdefault(form, {})[decode(key) or ""] = iri
                elif key != iri and form == "voxel" and _VOXEL.fullmatch(key):
                    known[iri] = (form, key)
                elif key != iri and _KEY.fullmatch(key):
                    known[iri] = (form, key if form == "former" else int(key))
        classes[iri] = iri
    rows = session.execute(
        "SELECT 'entity', name, id::text, name FROM entity "
        "WHERE map_id = (SELECT current_map()) AND name = ANY (%(names)s) "
        "UNION ALL SELECT 'type', iri, name, name FROM semantic_type "
        "WHERE iri = ANY (%(iris)s) OR name = ANY (%(types)s)",
        {"names": list(names), "iris": list(classes), "types": list(types)},
    ).fetchall()
    for kind, found, key, name in rows:
        if kind == "type":
            if found in classes:
                known[found] = ("type", key)
            for iri in types.get(name, ()):
                # Where an ontology declares the type, type:NAME is not its IRI.
                if found is None or not iri.startswith(TYPE):
                    either[iri] = key
    for kind, found, key, _ in rows:
        if kind == "entity":
            for iri, form in names[found]:
                known.setdefault(iri, (form, int(key)))
    for form, wanted in keyed.items():
        for key, number in _rows_of(session, form, wanted):
            known[wanted[key]] = (form, number)
    return Constants(known, either)


def _rows_of(
    session: psycopg.Connection[Any], form: Form, keys: Iterable[str]
) -> Iterable[tuple[str, int]]:
    """Return the key and the id of each row that has one of the keys in the IRIs of a node."""
    table, column, type_ = NODES[form].keyed or ("", "", "")
    if type_ == "uuid":
        keys = (key for key in keys if _UUID.fullmatch(key))
    text = f"SELECT {column}::text, id FROM {table} WHERE {column} = ANY (%s::text[]::{type_}[])"
    return session.execute(text.encode(), (list(keys),)).fetchall()


def _node_of_map(part: str) -> tuple[Form, str | None]:
    """Return the form of a node, and the name of its entity."""
    for form, node in NODES.items():
        if node.of_map and node.prefix and part.startswith(node.prefix):
            return form, decode(part[len(node.prefix) :])
    return "entity", decode(part)


def iris_in(tree: Any) -> Iterator[str]:
    """Yield the IRIs of a part of the algebra."""
    if isinstance(tree, rdflib.URIRef):
        yield str(tree)
    elif isinstance(tree, CompValue):
        for _, part in parts_of(tree):
            yield from iris_in(part)
    elif isinstance(tree, Path):
        yield from iris_in(list(vars(tree).values()))
    elif isinstance(tree, Mapping):
        for key, part in tree.items():
            yield from iris_in([key, part])
    elif isinstance(tree, Iterable) and not isinstance(tree, str | bytes):
        for part in tree:
            yield from iris_in(part)


def parts_of(tree: CompValue) -> Iterator[tuple[str, Any]]:
    """Yield name and value of each part of a node of the algebra.

    rdflib keeps the algebra of EXISTS as an attribute, beside the syntax without its filters.
    """
    for name, part in tree.items():
        if name != "_vars":
            yield name, vars(tree).get(name, part)


def tag_and_text(term: Any) -> tuple[str, str]:
    """Return the text and the tag of an rdflib term."""
    if isinstance(term, rdflib.Literal):
        if term.language:
            return str(term), f"@{term.language.lower()}"
        return str(term), str(term.datatype or f"{XSD}string")
    return str(term), "B" if isinstance(term, rdflib.BNode) else "I"
