"""Fields kept in the database, version by version: only cubes of voxels that changed are written.

With `source` and `mirror` the only modules of the fields that know it. A field is of the current
map; all that a call does is part of the caller's transaction.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Row, text

from semmap.fields.maps.representation_map import GRIDS, Grid, ValueType, value_type_of

__all__ = ["Kept", "Version", "forget", "load", "names", "prune", "save", "versions"]

EDGE = 32
"""Voxels; that of cubes of fields that are new.

Measured in small_house on voxels of 5 cm: a piece of furniture that moves changes 2.9 cubes of 32
(1.1 kB compressed), 1.5 of 64 (3.0 kB) or 5.5 of 16 (0.5 kB); all of the house is 237, 48 or 1105.
"""


@dataclass(frozen=True, eq=False)
class Kept:
    """A version of a field, and what is known of it.

    Attributes
    ----------
    property : str
        The IRI of what its values say.
    about : str or None
        Whom or what it is said of.
    legend : dict or None
        What each value of an int32 field stands for.
    state : dict or None
        What its writer left for itself.
    """

    name: str
    version: int
    at: datetime
    property: str
    about: str | None
    legend: dict[int, Any] | None
    state: dict[str, Any] | None
    grid: Grid


@dataclass(frozen=True)
class Version:
    """A version of a field, when it was saved, and how many cubes and bytes were written."""

    version: int
    at: datetime
    blocks: int
    bytes: int


def save(
    connection: Connection,
    name: str,
    grid: Grid,
    *,
    property: str,
    about: str | None = None,
    legend: Mapping[int, Any] | None = None,
    state: Mapping[str, Any] | None = None,
) -> int:
    """Keep a grid as the newest version of a field; the number of that version, from 1.

    Values, active states, background and placement come back bit for bit, an active voxel of
    background among them. A save of the same field by another process waits for this transaction.

    Parameters
    ----------
    name : unique in the map
    property : IRI of what the values say
    about : whom or what they are said of
    legend : what values of an int32 grid stand for, as JSON can hold it
    state : what the writer needs to go on from here, as JSON can hold it

    Raises
    ------
    LookupError
        There is no map.
    ValueError
        The field has another property, subject, type or voxel size, or what is given is no field.
    """
    value_type = value_type_of(grid)
    if not name or not property:
        raise ValueError("a field that is kept has a name and a property: give both")
    if legend is not None and value_type != "int32":
        raise ValueError(f"values of a {value_type} field stand for themselves: give no legend")
    given = (property, about, value_type, grid.voxel_size)
    field = _field_to_change(connection, name, given)
    version: int = field.version + 1
    blocks = grid.blocks(field.edge)
    digests = {at: hashlib.blake2b(b, digest_size=16).digest() for at, b in blocks.items()}
    before = {
        (row.x, row.y, row.z): row.digest
        for row in connection.execute(
            text(
                "SELECT x, y, z, digest FROM field_block WHERE field_id = :field AND until IS NULL"
            ),
            {"field": field.id},
        )
    }
    over = [at for at, digest in before.items() if digests.get(at) != digest]
    if over:
        connection.execute(
            text(
                "UPDATE field_block b SET until = :version "
                "FROM unnest(CAST(:x AS integer[]), CAST(:y AS integer[]), CAST(:z AS integer[])) "
                "AS o(x, y, z) WHERE b.field_id = :field AND b.until IS NULL "
                "AND (b.x, b.y, b.z) = (o.x, o.y, o.z)"
            ),
            {"field": field.id, "version": version}
            | {axis: [at[i] for at in over] for i, axis in enumerate("xyz")},
        )
    fresh = [at for at, digest in digests.items() if before.get(at) != digest]
    if fresh:
        connection.execute(
            text(
                "INSERT INTO field_block (field_id, x, y, z, since, digest, bytes) "
                "VALUES (:field, :x, :y, :z, :version, :digest, :bytes)"
            ),
            [
                {
                    "field": field.id, "x": at[0], "y": at[1], "z": at[2], "version": version,
                    "digest": digests[at], "bytes": blocks[at],
                }
                for at in fresh
            ],
        )  # fmt: skip
    connection.execute(
        text(
            "INSERT INTO field_version (field_id, version, background, placement, legend, state) "
            "VALUES (:field, :version, :background, :placement, CAST(:legend AS jsonb), "
            "CAST(:state AS jsonb))"
        ),
        {
            "field": field.id,
            "version": version,
            "background": float(grid.background),
            "placement": [number for row in grid.placement for number in row],
            "legend": None if legend is None else json.dumps(dict(legend)),
            "state": None if state is None else json.dumps(dict(state)),
        },
    )
    connection.execute(
        text("UPDATE field SET version = :version WHERE id = :field"),
        {"field": field.id, "version": version},
    )
    return version


def load(connection: Connection, name: str, version: int | None = None) -> Kept:
    """A version of a field, the newest if none is named.

    Raises
    ------
    LookupError
        There is no such field, or the version is not kept.
    """
    while True:
        field = _field(connection, name)
        number = field.version if version is None else version
        cubes = connection.execute(
            text(
                "SELECT x, y, z, bytes FROM field_block WHERE field_id = :field "
                "AND since <= :version AND (until IS NULL OR until > :version)"
            ),
            {"field": field.id, "version": number},
        ).all()
        # Asked last: while a version is there, so are all its cubes.
        row = connection.execute(
            text("SELECT * FROM field_version WHERE field_id = :field AND version = :version"),
            {"field": field.id, "version": number},
        ).one_or_none()
        if row is not None:
            break
        if version is not None:
            there = [str(each.version) for each in versions(connection, name)]
            raise LookupError(
                f"version {version} of the field {name} is not kept: there are {', '.join(there)}"
            )
    kind = GRIDS[_value_type(field.value_type)]
    plain = {"bool": bool, "int32": int, "float32": float}[field.value_type]
    grid = kind(field.voxel_size, plain(row.background))
    grid.place([row.placement[i : i + 4] for i in (0, 4, 8)])
    grid.put_blocks({(c.x, c.y, c.z): c.bytes for c in cubes}, field.edge)
    legend = None if row.legend is None else {int(k): v for k, v in row.legend.items()}
    return Kept(name, number, row.at, field.property, field.about, legend, row.state, grid)


def names(connection: Connection, *, stateless: bool = False) -> list[str]:
    """The fields of the current map that are kept; or those alone whose writer left no state."""
    return list(
        connection.execute(
            text(
                "SELECT f.name FROM field f "
                "JOIN field_version v ON v.field_id = f.id AND v.version = f.version "
                "WHERE f.map_id = current_map() AND NOT (:stateless AND v.state IS NOT NULL) "
                "ORDER BY f.name"
            ),
            {"stateless": stateless},
        ).scalars()
    )


def versions(connection: Connection, name: str) -> list[Version]:
    """The versions of a field that are kept, the oldest first.

    Raises
    ------
    LookupError
        There is no such field.
    """
    rows = connection.execute(
        text(
            "SELECT v.version, v.at, count(b.since) AS blocks, "
            "coalesce(sum(octet_length(b.bytes)), 0) AS bytes FROM field_version v "
            "LEFT JOIN field_block b ON b.field_id = v.field_id AND b.since = v.version "
            "WHERE v.field_id = :field GROUP BY v.version, v.at ORDER BY v.version"
        ),
        {"field": _field(connection, name).id},
    )
    return [Version(row.version, row.at, int(row.blocks), int(row.bytes)) for row in rows]


def prune(connection: Connection, name: str, keep: int) -> int:
    """Delete all but the newest versions of a field; how many were deleted.

    Parameters
    ----------
    keep : how many stay, at least 1

    Raises
    ------
    LookupError
        There is no such field.
    ValueError
        None would stay.
    """
    if keep < 1:
        raise ValueError(f"keep is {keep}: at least 1 version stays; forget deletes the field")
    field = _field(connection, name, locked=True)
    oldest = field.version - keep + 1
    gone = connection.execute(
        text("DELETE FROM field_version WHERE field_id = :field AND version < :oldest"),
        {"field": field.id, "oldest": oldest},
    )
    connection.execute(
        text("DELETE FROM field_block WHERE field_id = :field AND until <= :oldest"),
        {"field": field.id, "oldest": oldest},
    )
    return int(gone.rowcount)


def forget(connection: Connection, name: str) -> None:
    """Delete a field with all its versions; one that is not kept is not there to delete."""
    connection.execute(
        text("DELETE FROM field WHERE map_id = current_map() AND name = :name"), {"name": name}
    )


def _field_to_change(
    connection: Connection, name: str, given: tuple[str, str | None, str, float]
) -> Row[Any]:
    """The field, made if it is not there, and locked until the transaction ends."""
    if connection.execute(text("SELECT current_map()")).scalar() is None:
        raise LookupError("there is no map to keep a field of: semmap import FILE makes one")
    connection.execute(
        text(
            "INSERT INTO field (map_id, name, property, about, value_type, voxel_size, edge) "
            "VALUES (current_map(), :name, :property, :about, :type, :size, :edge) "
            "ON CONFLICT (map_id, name) DO NOTHING"
        ),
        dict(zip(("property", "about", "type", "size"), given, strict=True))
        | {"name": name, "edge": EDGE},
    )
    field = _field(connection, name, locked=True)
    there = (field.property, field.about, field.value_type, field.voxel_size)
    if there != given:
        raise ValueError(
            f"the field {name} is kept as {_said(there)}, this one is {_said(given)}: give it "
            "another name, or forget the kept one"
        )
    return field


def _field(connection: Connection, name: str, *, locked: bool = False) -> Row[Any]:
    field = connection.execute(
        text(
            "SELECT * FROM field WHERE map_id = current_map() AND name = :name"
            + (" FOR UPDATE" if locked else "")
        ),
        {"name": name},
    ).one_or_none()
    if field is None:
        known = ", ".join(names(connection)) or "none"
        raise LookupError(f"no field {name} is kept of this map; there are: {known}")
    return field


def _said(what: tuple[str, str | None, str, float]) -> str:
    property, about, value_type, voxel_size = what
    return f"{value_type} of {property} about {about or 'nobody'} on voxels of {voxel_size} m"


def _value_type(value: str) -> ValueType:
    return next(each for each in GRIDS if each == value)
