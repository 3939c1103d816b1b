"""The T-Box into the database: `schema/ontology/*.ttl`, again when its files change."""

from __future__ import annotations

import hashlib

from sqlalchemy import Connection

from semmap.ingest.ontology.tbox import ontology_files, own_tbox


def load_tbox(connection: Connection) -> int:
    """Store the semantic types of the ontology files; return their number, 0 if nothing changed.

    Types that imports added stay; a type that an ontology now has becomes the ontology's. Unchanged
    files are not read.
    """
    files = ontology_files()
    digest = hashlib.sha256(b"".join(p.read_bytes() for p in files)).hexdigest()
    name = ",".join(p.name for p in files)
    known = connection.exec_driver_sql(
        "SELECT digest FROM ontology WHERE name = %(name)s", {"name": name}
    ).scalar()
    if known == digest:
        return 0
    records = own_tbox()
    # One statement each: a trigger recomputes the closure after every one.
    connection.exec_driver_sql(
        "INSERT INTO semantic_type (name, label, iri, comment, origin) "
        "SELECT *, 'ontology' FROM unnest(%(names)s::text[], %(labels)s::text[], %(iris)s::text[], "
        "%(comments)s::text[]) "
        "ON CONFLICT (name) DO UPDATE SET label = excluded.label, iri = excluded.iri, "
        "comment = excluded.comment, origin = CASE semantic_type.origin WHEN 'schema' "
        "THEN 'schema' ELSE 'ontology' END",
        {
            "names": [r.name for r in records],
            "labels": [r.label for r in records],
            "iris": [r.iri for r in records],
            "comments": [r.comment for r in records],
        },
    )
    connection.exec_driver_sql(
        "UPDATE semantic_type t SET typical_size = CAST(s.size AS float8[]), found_in = s.places, "
        "functions = s.functions, keeps = s.keeps "
        "FROM (SELECT name, size, string_to_array(places, ',') AS places, "
        "string_to_array(functions, ',') AS functions, keeps "
        "FROM unnest(%(names)s::text[], %(sizes)s::text[], %(places)s::text[], "
        "%(functions)s::text[], %(keeps)s::float8[]) s(name, size, places, functions, keeps)) s "
        "WHERE t.name = s.name AND (t.typical_size, t.found_in, t.functions, t.keeps) "
        "IS DISTINCT FROM (CAST(s.size AS float8[]), s.places, s.functions, s.keeps)",
        {
            "names": [r.name for r in records],
            "sizes": [_array(r.typical_size) for r in records],
            "places": [",".join(r.found_in) for r in records],
            "functions": [",".join(r.functions) for r in records],
            "keeps": [r.keeps for r in records],
        },
    )
    edges = [{"type": r.name, "parent": p} for r in records for p in r.parents]
    connection.exec_driver_sql(
        "DELETE FROM type_parent WHERE type = ANY(%(names)s) AND type IN "
        "(SELECT name FROM semantic_type WHERE origin = 'ontology')",
        {"names": [r.name for r in records]},
    )
    connection.exec_driver_sql(
        "INSERT INTO type_parent (type, parent) SELECT * FROM "
        "unnest(%(types)s::text[], %(parents)s::text[]) ON CONFLICT DO NOTHING",
        {"types": [e["type"] for e in edges], "parents": [e["parent"] for e in edges]},
    )
    connection.exec_driver_sql(
        "INSERT INTO ontology (name, digest) VALUES (%(name)s, %(digest)s) "
        "ON CONFLICT (name) DO UPDATE SET digest = excluded.digest",
        {"name": name, "digest": digest},
    )
    return len(records)


def _array(size: tuple[float, float, float] | None) -> str | None:
    """A size as PostgreSQL writes an array."""
    return None if size is None else "{" + ",".join(map(str, size)) + "}"
