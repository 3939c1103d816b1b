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
    edges = [(r.name, parent) for r in records for parent in r.parents]
    values = {
        "names": [r.name for r in records],
        "labels": [r.label for r in records],
        "iris": [r.iri for r in records],
        "comments": [r.comment for r in records],
        "sizes": [r.typical_size and " ".join(map(str, r.typical_size)) for r in records],
        "places": [" ".join(r.found_in) for r in records],
        "functions": [" ".join(r.functions) for r in records],
        "keeps": [r.keeps for r in records],
        "types": [type_ for type_, _ in edges],
        "parents": [parent for _, parent in edges],
        "name": name,
        "digest": digest,
    }
    # One statement each: a trigger recomputes the closure after every one.
    for statement in (
        "INSERT INTO semantic_type AS t (name, label, iri, comment, origin, typical_size, "
        "found_in, functions, keeps) SELECT name, label, iri, comment, 'ontology', "
        "string_to_array(size, ' ')::float8[], string_to_array(places, ' '), "
        "string_to_array(functions, ' '), keeps FROM unnest(%(names)s::text[], %(labels)s::text[], "
        "%(iris)s::text[], %(comments)s::text[], %(sizes)s::text[], %(places)s::text[], "
        "%(functions)s::text[], %(keeps)s::float8[]) "
        "r (name, label, iri, comment, size, places, functions, keeps) ON CONFLICT (name) "
        "DO UPDATE SET label = excluded.label, iri = excluded.iri, comment = excluded.comment, "
        "origin = CASE t.origin WHEN 'schema' THEN 'schema' ELSE 'ontology' END, "
        "typical_size = excluded.typical_size, found_in = excluded.found_in, "
        "functions = excluded.functions, keeps = excluded.keeps",
        "DELETE FROM type_parent WHERE type = ANY(%(names)s) AND type IN "
        "(SELECT name FROM semantic_type WHERE origin = 'ontology')",
        "INSERT INTO type_parent (type, parent) SELECT * FROM "
        "unnest(%(types)s::text[], %(parents)s::text[]) ON CONFLICT DO NOTHING",
        "INSERT INTO ontology (name, digest) VALUES (%(name)s, %(digest)s) "
        "ON CONFLICT (name) DO UPDATE SET digest = excluded.digest",
    ):
        connection.exec_driver_sql(statement, values)
    return len(records)
