"""A `World` into the database; of a repeated import, what its source changed, added or removed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import psycopg
from psycopg.rows import namedtuple_row
from psycopg.types.json import Jsonb
from psycopg.types.range import TimestamptzRange

from semmap.ingest.georeference import on_grid
from semmap.ingest.store.copy_rows import copy_rows
from semmap.ingest.store.model_store import Progress, shape_digest, store_models
from semmap.ingest.world import (
    OUTSIDE,
    ConnectorDetail,
    Entry,
    PlaceDetail,
    RegionDetail,
    StoreyDetail,
    World,
    WorldError,
    unique_name,
)

LOCK_IMPORTS = "SELECT pg_advisory_xact_lock(hashtext('semmap.import'))"
"""Lets no other transaction store a world, or drop a map, until this one ends."""

SAME_ELEVATION = 0.01
"""Metres by which the elevations of a storey in two files may differ."""


@dataclass
class StoreSummary:
    """How many entities storing a world added, changed and removed; meshes stored, each once."""

    added: int = 0
    changed: int = 0
    removed: int = 0
    unchanged: int = 0
    models: int = 0
    triangles: int = 0
    notes: list[str] = field(default_factory=list)


def store_world(
    connection: psycopg.Connection[Any],
    map_id: int,
    world: World,
    source: str | None = None,
    progress: Progress = lambda stage, done, total: None,
) -> StoreSummary:
    """Store a world in a map; without a source, a repeated import does not find its entities."""
    stored = StoreSummary(notes=list(world.notes))
    with connection.cursor() as cursor:
        cursor.execute(LOCK_IMPORTS)
        entries = _unique_names(cursor, map_id, world, source, stored)
        _add_types(cursor, entries, stored)
        models, stored.models = store_models(cursor, entries, progress)

        known = _known(cursor, map_id)
        digests = {entry.name: digest_of(entry) for entry in entries}
        fresh, changed, annotations = [], [], []
        for entry in entries:
            old = known.get(entry.name)
            if old is None:
                fresh.append(entry)
            elif old.source != source:
                annotations.append(entry)
            elif old.digest != digests[entry.name]:
                changed.append(entry)
        kept = {entry.name for entry in entries}
        of_source = [n for n, old in known.items() if old.source == source is not None]
        gone = [n for n in of_source if n not in kept]
        regrown = [e for e in changed if known[e.name].kind != e.kind]
        gone += [e.name for e in regrown]
        changed = [e for e in changed if known[e.name].kind == e.kind]
        fresh += regrown

        if gone:
            cursor.execute(
                "DELETE FROM entity WHERE map_id = %s AND name = ANY(%s)", (map_id, gone)
            )
        ids = {name: old.id for name, old in known.items() if name not in set(gone)}
        ids |= _insert_entities(cursor, map_id, fresh, source, digests, progress)
        _update_entities(cursor, changed, ids, digests)
        _annotate(cursor, annotations, ids, stored)
        _store_details(cursor, fresh + changed, ids, world)
        _give_models(cursor, fresh, changed, ids, models)
        _place(cursor, fresh, changed, ids, world, progress)
        _link(cursor, map_id, world, ids, source)
        _georeference(cursor, map_id, world)

        stored.added, stored.changed = len(fresh), len(changed)
        stored.removed = len([n for n in gone if n not in kept])
        stored.unchanged = len(entries) - len(fresh) - len(changed) - len(annotations)
        stored.triangles = sum(s.mesh.faces.shape[0] for e in entries for s in e.shapes if s.mesh)
    return stored


def _known(cursor: psycopg.Cursor[Any], map_id: int) -> dict[str, Any]:
    """The rows of the map's entities by name: id, kind, source, digest and elevation."""
    rows: psycopg.Cursor[Any] = cursor.connection.cursor(row_factory=namedtuple_row)
    rows.execute(
        "SELECT name, id, kind, source, digest, elevation FROM entity "
        "LEFT JOIN storey ON entity_id = id WHERE map_id = %s",
        (map_id,),
    )
    return {row.name: row for row in rows}


def _is_same(entry: Entry, old: Any) -> bool:
    """Return whether an entry is the entity of its name, and not another one."""
    if entry.shapes or entry.kind != old.kind:
        return False
    if isinstance(entry.detail, StoreyDetail):
        return bool(abs(entry.detail.elevation - old.elevation) < SAME_ELEVATION)
    return entry.pose is None


def _unique_names(
    cursor: psycopg.Cursor[Any],
    map_id: int,
    world: World,
    source: str | None,
    stored: StoreSummary,
) -> list[Entry]:
    """Return the entries under names that no other source has, unless they annotate its entity.

    An entry without a place annotates the entity of its name; a storey without an outline is that
    of its name at its elevation.
    """
    others = {n: old for n, old in _known(cursor, map_id).items() if old.source != source}
    renamed: dict[str, str] = {}
    taken = {entry.name for entry in world.entries} | others.keys()
    for entry in world.entries:
        old = others.get(entry.name)
        if old is None or _is_same(entry, old):
            continue
        name = renamed[entry.name] = unique_name(entry.name, taken)
        taken.add(name)
        stored.notes.append(f"{entry.name}: the map has one already; this one is {name}")
    if renamed:
        for entry in world.entries:
            entry.name = renamed.get(entry.name, entry.name)
            entry.holder = renamed.get(entry.holder, entry.holder) if entry.holder else None
            if isinstance(entry.detail, ConnectorDetail):
                a, b = entry.detail.places
                entry.detail.places = (renamed.get(a, a), renamed.get(b, b))
            if isinstance(entry.detail, PlaceDetail) and entry.detail.elevator:
                entry.detail.elevator = renamed.get(entry.detail.elevator, entry.detail.elevator)
        for link in world.links:
            link.subject = renamed.get(link.subject, link.subject)
            link.object = renamed.get(link.object, link.object)
    return world.entries


def _add_types(cursor: psycopg.Cursor[Any], entries: Iterable[Entry], stored: StoreSummary) -> None:
    """Add types that the T-Box lacks, each below the entry's kind, and note them."""
    kinds = {entry.type: entry.kind for entry in entries if entry.type}
    cursor.execute("SELECT name FROM semantic_type WHERE name = ANY(%s)", (list(kinds),))
    new = sorted(set(kinds).difference(name for (name,) in cursor))
    if new:
        cursor.execute(
            "INSERT INTO semantic_type (name, origin) SELECT t, 'import' FROM unnest(%s::text[]) t",
            (new,),
        )
        cursor.execute(
            "INSERT INTO type_parent (type, parent) SELECT * FROM unnest(%s::text[], %s::text[])",
            (new, [kinds[t] for t in new]),
        )
        stored.notes += [f"type {t}: not in the T-Box, added below {kinds[t]}" for t in new]


def digest_of(entry: Entry) -> str:
    """Return a digest of all that an entry says, by which a second import finds what changed."""
    given = {k: v for k, v in vars(entry).items() if k not in ("shapes", "detail", "pose")}
    if entry.relation == "in":  # digests of 0.1.0 have none
        del given["relation"]
    given["pose"] = entry.pose._asdict() if entry.pose else None
    given["detail"] = asdict(entry.detail) if entry.detail else None
    if isinstance(entry.detail, ConnectorDetail):
        given["detail"]["poses"] = [pose._asdict() for pose in entry.detail.poses]
    given["shapes"] = [(shape_digest(s), s.role, s.uri) for s in entry.shapes]
    return hashlib.sha256(json.dumps(given, sort_keys=True, default=str).encode()).hexdigest()


def _insert_entities(
    cursor: psycopg.Cursor[Any],
    map_id: int,
    entries: Sequence[Entry],
    source: str | None,
    digests: dict[str, str],
    progress: Progress,
) -> dict[str, int]:
    """Insert entities; return their ids by name."""
    progress("entities", 0, len(entries))
    if not entries:
        return {}
    columns = ["map_id", "kind", "name", "label", "type", "properties", "front"]
    rows = [
        [map_id, e.kind, e.name, e.label, e.type, Jsonb(e.properties), e.front] for e in entries
    ]
    if source is not None:  # a robot, which imports nothing, may not write these
        columns += ["source", "digest"]
        rows = [[*row, source, digests[e.name]] for row, e in zip(rows, entries, strict=True)]
    copy_rows(cursor, "entity", columns, rows)
    cursor.execute(
        "SELECT name, id FROM entity WHERE map_id = %s AND name = ANY(%s)",
        (map_id, [e.name for e in entries]),
    )
    progress("entities", len(entries), len(entries))
    return dict(cursor.fetchall())


def _update_entities(
    cursor: psycopg.Cursor[Any],
    entries: Sequence[Entry],
    ids: dict[str, int],
    digests: dict[str, str],
) -> None:
    for e in entries:
        cursor.execute(
            "UPDATE entity SET label = %s, type = %s, properties = %s, front = %s, digest = %s "
            "WHERE id = %s",
            (e.label, e.type, Jsonb(e.properties), e.front, digests[e.name], ids[e.name]),
        )


def _annotate(
    cursor: psycopg.Cursor[Any], entries: Sequence[Entry], ids: dict[str, int], stored: StoreSummary
) -> None:
    for e in entries:
        given = {"type": e.type, "label": e.label, "id": ids[e.name]}
        cursor.execute(
            "UPDATE entity SET type = coalesce(%(type)s, type), "
            "label = coalesce(%(label)s, label), properties = properties || %(properties)s "
            "WHERE id = %(id)s AND NOT ("
            "type IS NOT DISTINCT FROM coalesce(%(type)s, type) AND "
            "label IS NOT DISTINCT FROM coalesce(%(label)s, label) AND "
            "properties @> %(properties)s)",
            given | {"properties": Jsonb(e.properties)},
        )
        if cursor.rowcount:
            stored.notes.append(f"{e.name}: annotated")


def _store_details(
    cursor: psycopg.Cursor[Any], entries: Sequence[Entry], ids: dict[str, int], world: World
) -> None:
    """Store the rows of each kind's table, elevators before cabins, rooms before doors."""
    for kind in ("storey", "elevator", "room", "connector", "region"):
        for e in (e for e in entries if e.kind == kind):
            columns = _detail(e, ids, world)
            names, marks = ", ".join(columns), ", ".join(["%s"] * (1 + len(columns)))
            updates = ", ".join(f"{name} = excluded.{name}" for name in columns)
            action = f"UPDATE SET {updates}" if columns else "NOTHING"
            statement = (
                f"INSERT INTO {kind} (entity_id{', ' if columns else ''}{names}) VALUES ({marks}) "
                f"ON CONFLICT (entity_id) DO {action}"
            )
            cursor.execute(statement.encode(), [ids[e.name], *columns.values()])


def _detail(entry: Entry, ids: dict[str, int], world: World) -> dict[str, Any]:
    match entry.detail:
        case StoreyDetail() as level:
            return {"elevation": level.elevation, "height": level.height}
        case PlaceDetail() as place:
            cabin_of = _id_of(ids, place.elevator, entry, world) if place.elevator else None
            return {"floor": place.floor, "ceiling": place.ceiling, "elevator_id": cabin_of}
        case RegionDetail() as region:
            return {"valid": TimestamptzRange(region.since, region.until)}
        case ConnectorDetail() as c:
            a, b = c.places
            same = ("direction", "state", "behaviour", "width", "height", "step")
            return {
                "form": c.type,
                "place_a": _id_of(ids, a, entry, world),
                "place_b": None if b == OUTSIDE else _id_of(ids, b, entry, world),
                "pose_a": c.poses[0].row,
                "pose_b": c.poses[1].row,
                "permissions": list(c.permissions),
                **{name: getattr(c, name) for name in same},
            }
    if entry.kind == "connector":
        problem = "does not join two places"
        raise WorldError(world.source, entry.name, problem, "Name the places it joins.")
    return {}


def _id_of(ids: dict[str, int], name: str, entry: Entry, world: World) -> int:
    """Return the id of an entity that an entry names, in the file or in the map."""
    if name not in ids:
        problem = f"names {name}, which is neither in the file nor in the map"
        fix = "Import what it names first, or correct the name."
        raise WorldError(world.source, entry.name, problem, fix)
    return ids[name]


def _give_models(
    cursor: psycopg.Cursor[Any],
    fresh: Sequence[Entry],
    changed: Sequence[Entry],
    ids: dict[str, int],
    models: dict[int, int],
) -> None:
    wanted = {(ids[e.name], models[id(s)], s.role) for e in [*fresh, *changed] for s in e.shapes}
    if changed:
        cursor.execute(
            "SELECT entity_id, model_id, role FROM entity_model WHERE entity_id = ANY(%s)",
            ([ids[e.name] for e in changed],),
        )
        has = {tuple(row) for row in cursor}
        cursor.executemany(
            "DELETE FROM entity_model WHERE (entity_id, model_id, role) = (%s, %s, %s)",
            sorted(has - wanted),
        )
        wanted -= has
    if wanted:
        copy_rows(cursor, "entity_model", ("entity_id", "model_id", "role"), sorted(wanted))


def _place(
    cursor: psycopg.Cursor[Any],
    fresh: Sequence[Entry],
    changed: Sequence[Entry],
    ids: dict[str, int],
    world: World,
    progress: Progress,
) -> None:
    def rows(entries: Sequence[Entry]) -> list[tuple[Any, ...]]:
        return [
            (
                ids[e.name],
                _id_of(ids, e.holder, e, world) if e.holder else None,
                e.pose.row,
                e.relation,
            )
            for e in entries
            if e.pose is not None
        ]

    placed = rows(fresh)
    progress("placements", 0, len(placed))
    if placed:
        copy_rows(cursor, "placement", ("entity_id", "holder_id", "pose", "relation"), placed)
    again = rows(changed)
    if again:
        cursor.executemany(
            "INSERT INTO placement (entity_id, holder_id, pose, relation) VALUES (%s, %s, %s, %s) "
            "ON CONFLICT (entity_id) DO UPDATE SET holder_id = excluded.holder_id, "
            "pose = excluded.pose, relation = excluded.relation, confidence = NULL",
            again,
        )
    progress("placements", len(placed), len(placed))


def _link(
    cursor: psycopg.Cursor[Any], map_id: int, world: World, ids: dict[str, int], source: str | None
) -> None:
    """Store the links of the world; delete links between its entities that it no longer has."""
    links = {
        (ids[link.subject], link.relation, ids[link.object]): Jsonb(link.properties)
        for link in world.links
        if link.subject in ids and link.object in ids
    }
    if links:
        subjects, relations, objects = (list(column) for column in zip(*links, strict=True))
        given = {"from": subjects, "given": relations, "to": objects}
        cursor.execute(
            "INSERT INTO link (from_id, relation, to_id, properties) SELECT * FROM "
            "unnest(%(from)s::bigint[], %(given)s::text[], %(to)s::bigint[], %(values)s::jsonb[]) "
            "ON CONFLICT (from_id, relation, to_id) DO UPDATE SET properties = excluded.properties "
            "WHERE link.properties IS DISTINCT FROM excluded.properties",
            {**given, "values": list(links.values())},
        )
        cursor.execute(
            "DELETE FROM link USING entity a, entity b WHERE a.id = from_id AND b.id = to_id "
            "AND a.source = %(source)s AND b.source = %(source)s "
            "AND a.map_id = %(map)s AND b.map_id = %(map)s AND relation = ANY(%(relations)s) "
            "AND (from_id, relation, to_id) NOT IN "
            "(SELECT * FROM unnest(%(from)s::bigint[], %(given)s::text[], %(to)s::bigint[]))",
            {**given, "source": source, "map": map_id, "relations": sorted(set(relations))},
        )


def _georeference(cursor: psycopg.Cursor[Any], map_id: int, world: World) -> None:
    """Store the georeference; without one in the file, the map keeps its own."""
    given = world.georeference
    if not given:
        return
    cursor.execute(
        "UPDATE map SET crs = %(crs)s, easting = %(easting)s, northing = %(northing)s, "
        "height = %(height)s, rotation = %(rotation)s WHERE id = %(id)s",
        {**on_grid(given), "id": map_id},
    )
