"""Fields of the current map with all their versions; only cubes of voxels that changed are written.

All changes of a call are part of the transaction of the caller. Why:
docs/decisions/a_stored_field_has_cubes_of_32_voxels_in_its_own_format.md
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from semmap.fields.maps.grids import GRIDS, Grid, value_type_of
from semmap.fields.store.run_statement import Connection, run
from semmap.query.snapshot import Snapshot

EDGE = 32
"""Edge of the cubes of new fields, in voxels.

Measured in small_house with voxels of 5 cm: moving a piece of furniture changes 2.9 cubes of 32
(1.1 kB compressed), 1.5 of 64 (3.0 kB) or 5.5 of 16 (0.5 kB); the whole house has 237, 48 or 1105.
"""


@dataclass(frozen=True, eq=False)
class StoredField:
    """A version of a field."""

    name: str  # of the field
    version: int  # counted from 1
    at: datetime  # when it was stored, aware
    property: str  # IRI of the property
    about: str | None  # the entity that the field is about, if any
    legend: dict[int, Any] | None  # the entities of the values of an int32 field, if any
    state: dict[str, Any] | None  # data of the writer, if any
    grid: Grid  # the voxels


@dataclass(frozen=True)
class VersionSummary:
    """The size of a version of a field."""

    version: int  # counted from 1
    at: datetime  # when it was stored, aware
    blocks: int  # number of cubes that were written
    bytes: int  # bytes that were written


def save(
    connection: Connection,
    name: str,
    grid: Grid,
    *,
    property: str,
    about: str | None = None,
    legend: Mapping[int, Any] | None = None,
    state: Mapping[str, Any] | None = None,
    at: datetime | None = None,
    answer: bool = False,
) -> int:
    """Store a grid as the newest version of a field; return its number, from 1.

    `load` returns values, active states, background and placement bit by bit. If another process
    stores the same field, it waits for this transaction, which the caller commits.

    Parameters
    ----------
    name : of the field, unique in the map
    property : IRI of the property
    about : the entity that the field is about
    legend : the entities of the values of an int32 grid, as JSON allows
    state : data of the writer, as JSON allows
    at : from when on the grid is valid, aware; now if not given
    answer : whether it is the answer of a query, which is no obstacle unless a policy says so

    Raises
    ------
    LookupError
        There is no map.
    ValueError
        The field is stored as another one, or an argument is wrong.
    """
    value_type = value_type_of(grid)
    if not name or not property:
        raise ValueError("a field needs a name and a property: give both")
    if "\0" in name:
        raise ValueError(
            f"the name {name!r} has a NUL, which the database cannot store: leave it out"
        )
    if legend is not None and value_type != "int32":
        raise ValueError(f"a {value_type} field cannot have a legend: leave it out")
    given = (property, about, value_type, grid.voxel_size)
    field = _field_to_change(connection, name, given)
    version: int = field.version + 1
    blocks = grid.blocks(field.edge)
    digests = {at: hashlib.blake2b(b, digest_size=16).digest() for at, b in blocks.items()}
    before = {
        (row.x, row.y, row.z): row.digest
        for row in run(
            connection,
            "SELECT x, y, z, digest FROM field_block WHERE field_id = %(field)s AND until IS NULL",
            {"field": field.id},
        )
    }
    over = [at for at, digest in before.items() if digests.get(at) != digest]
    if over:
        run(
            connection,
            "UPDATE field_block b SET until = %(version)s "
            "FROM unnest(%(x)s::integer[], %(y)s::integer[], %(z)s::integer[]) AS o(x, y, z) "
            "WHERE b.field_id = %(field)s AND b.until IS NULL "
            "AND (b.x, b.y, b.z) = (o.x, o.y, o.z)",
            {"field": field.id, "version": version}
            | {axis: [at[i] for at in over] for i, axis in enumerate("xyz")},
        )
    fresh = [at for at, digest in digests.items() if before.get(at) != digest]
    if fresh:
        run(
            connection,
            "INSERT INTO field_block (field_id, x, y, z, since, digest, bytes) "
            "VALUES (%(field)s, %(x)s, %(y)s, %(z)s, %(version)s, %(digest)s, %(bytes)s)",
            [
                {"field": field.id, "version": version}
                | dict(zip("xyz", at, strict=True))
                | {"digest": digests[at], "bytes": blocks[at]}
                for at in fresh
            ],
        )
    run(
        connection,
        "INSERT INTO field_version (field_id, version, at, background, placement, legend, state, "
        "answer) VALUES (%(field)s, %(version)s, coalesce(%(at)s, statement_timestamp()), "
        "%(background)s, %(placement)s, %(legend)s::jsonb, %(state)s::jsonb, %(answer)s)",
        {
            "field": field.id,
            "version": version,
            "at": at,
            "background": float(grid.background),
            "placement": [number for row in grid.placement for number in row],
            "legend": None if legend is None else json.dumps(dict(legend)),
            "state": None if state is None else json.dumps(dict(state)),
            "answer": answer,
        },
    )
    run(
        connection,
        "UPDATE field SET version = %(version)s WHERE id = %(field)s",
        {"field": field.id, "version": version},
    )
    return version


def load(seen: Snapshot, name: str, version: int | None = None) -> StoredField:
    """Return a version of a field, by default the newest; LookupError if there is none."""
    while True:
        field = _field(seen.session, name)
        number = field.version if version is None else version
        cubes = run(
            seen.session,
            "SELECT x, y, z, bytes FROM field_block WHERE field_id = %(field)s "
            "AND since <= %(version)s AND (until IS NULL OR until > %(version)s)",
            {"field": field.id, "version": number},
        )
        # Read last: while a version exists, all its cubes exist.
        rows = run(
            seen.session,
            "SELECT * FROM field_version WHERE field_id = %(field)s AND version = %(version)s",
            {"field": field.id, "version": number},
        )
        if rows:
            break
        if version is not None:
            there = [str(each.version) for each in versions(seen, name)]
            raise LookupError(
                f"there is no version {version} of the field {name}; versions: {', '.join(there)}"
            )
    (row,) = rows
    kind = GRIDS[field.value_type]
    plain = {"bool": bool, "int32": int, "float32": float}[field.value_type]
    grid = kind(field.voxel_size, plain(row.background))
    grid.place([row.placement[i : i + 4] for i in (0, 4, 8)])
    grid.put_blocks({(c.x, c.y, c.z): c.bytes for c in cubes}, field.edge)
    legend = None if row.legend is None else {int(k): v for k, v in row.legend.items()}
    return StoredField(name, number, row.at, field.property, field.about, legend, row.state, grid)


def names(seen: Snapshot) -> list[str]:
    """Return the names of the map's fields without data of their writer."""
    return _names(seen.session)


def has_maps(seen: Snapshot) -> bool:
    """Return whether the current map has any field besides the states of mirrors."""
    rows = run(
        seen.session,
        "SELECT EXISTS (SELECT FROM field WHERE map_id = current_map() "
        "AND name NOT LIKE 'occupied % m') AS so",
    )
    return bool(rows[0].so)


def versions(seen: Snapshot, name: str) -> list[VersionSummary]:
    """Return the versions of a field, the oldest first; LookupError if there is no such field."""
    rows = run(
        seen.session,
        "SELECT v.version, v.at, count(b.since) AS blocks, "
        "coalesce(sum(octet_length(b.bytes)), 0) AS bytes FROM field_version v "
        "LEFT JOIN field_block b ON b.field_id = v.field_id AND b.since = v.version "
        "WHERE v.field_id = %(field)s GROUP BY v.version, v.at ORDER BY v.version",
        {"field": _field(seen.session, name).id},
    )
    return [VersionSummary(row.version, row.at, int(row.blocks), int(row.bytes)) for row in rows]


def prune(connection: Connection, name: str, keep: int) -> int:
    """Delete all but the newest versions of a field; return how many were deleted.

    Raises LookupError: there is no such field. Raises ValueError: `keep` is below 1.
    """
    if keep < 1:
        raise ValueError(f"keep is {keep}: give at least 1; forget deletes the whole field")
    field = _field(connection, name, locked=True)
    oldest = field.version - keep + 1
    gone = run(
        connection,
        "DELETE FROM field_version WHERE field_id = %(field)s AND version < %(oldest)s "
        "RETURNING version",
        {"field": field.id, "oldest": oldest},
    )
    run(
        connection,
        "DELETE FROM field_block WHERE field_id = %(field)s AND until <= %(oldest)s",
        {"field": field.id, "oldest": oldest},
    )
    return len(gone)


def forget(connection: Connection, name: str) -> None:
    """Delete a field with all its versions. Does nothing if the field is unknown."""
    run(
        connection,
        "DELETE FROM field WHERE map_id = current_map() AND name = %(name)s",
        {"name": name},
    )


def _field_to_change(
    connection: Connection, name: str, given: tuple[str, str | None, str, float]
) -> Any:
    """Return the row of a field, new or not, locked until the end of the transaction."""
    if run(connection, "SELECT current_map() AS id", {})[0].id is None:
        raise LookupError("there is no map to store a field for: semmap import FILE makes one")
    run(
        connection,
        "INSERT INTO field (map_id, name, property, about, value_type, voxel_size, edge) "
        "VALUES (current_map(), %(name)s, %(property)s, %(about)s, %(type)s, %(size)s, %(edge)s) "
        "ON CONFLICT (map_id, name) DO NOTHING",
        dict(zip(("property", "about", "type", "size"), given, strict=True))
        | {"name": name, "edge": EDGE},
    )
    field = _field(connection, name, locked=True)
    there = (field.property, field.about, field.value_type, field.voxel_size)
    if there != given:
        raise ValueError(
            f"the field {name} is stored as {_described(there)}, but this one is "
            f"{_described(given)}: give it another name, or forget the stored field"
        )
    return field


def _names(connection: Connection) -> list[str]:
    rows = run(
        connection,
        "SELECT f.name FROM field f "
        "JOIN field_version v ON v.field_id = f.id AND v.version = f.version "
        "WHERE f.map_id = current_map() AND v.state IS NULL ORDER BY f.name",
    )
    return [row.name for row in rows]


def _field(connection: Connection, name: str, *, locked: bool = False) -> Any:
    fields = run(
        connection,
        "SELECT * FROM field WHERE map_id = current_map() AND name = %(name)s"
        + (" FOR UPDATE" if locked else ""),
        {"name": name},
    )
    if not fields:
        known = ", ".join(_names(connection)) or "none"
        raise LookupError(f"there is no field {name} in this map; fields: {known}")
    return fields[0]


def _described(field: tuple[str, str | None, str, float]) -> str:
    property, about, value_type, voxel_size = field
    entity = f" about {about}" if about else ""
    return f"{value_type} values of {property}{entity}, voxels of {voxel_size} m"
