"""Reads what queries may name: properties of the ontology, entities and types of the map."""

from __future__ import annotations

from semmap.database.files import schema_folder
from semmap.fields.maps.vocabulary import Vocabulary, read_vocabulary
from semmap.fields.store.run_statement import run
from semmap.language.names import NameIndex
from semmap.query.snapshot import Snapshot
from semmap.snake_case import snake_case


def read_map_vocabulary() -> Vocabulary:
    """Return the properties that the ontology of semmap declares."""
    return read_vocabulary([schema_folder() / "ontology" / "fields.ttl"])


def read_names(seen: Snapshot) -> NameIndex:
    """Return the entities of the current map with their types, and the types of the T-Box."""
    entities = run(
        seen.session,
        "SELECT name, coalesce(type, kind) AS type FROM entity WHERE map_id = current_map()",
    )
    supertypes: dict[str, set[str]] = {}
    for sub, super_ in run(seen.session, "SELECT sub, super FROM type_closure"):
        supertypes.setdefault(sub, set()).add(super_)
    labels = run(seen.session, "SELECT name, label FROM semantic_type WHERE label <> name")
    return NameIndex(
        {row.name: row.type for row in entities},
        {sub: frozenset(each) for sub, each in supertypes.items()},
        {snake_case(row.label): row.name for row in labels},
    )
