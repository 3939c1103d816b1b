"""Reads the voxels of the map's fields: the one reader of fields for grids and costmaps."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import Connection, text

from navgrid.field_layer import FieldVoxels, field_voxels
from semmap.language.terms import local_name
from semmap.suggestions import suggestion

__all__ = ["read_field_versions", "read_fields"]

_VERSIONS = """
SELECT f.name, f.id, f.version FROM field f
JOIN field_version v ON v.field_id = f.id AND v.version = f.version
WHERE f.map_id = current_map() AND v.state IS NULL ORDER BY f.name
"""
"""The state of a mirror is not a field."""


def read_field_versions(connection: Connection) -> dict[str, tuple[int, int]]:
    """Return the id and the newest version of each field of the current map, by name."""
    return {row.name: (row.id, row.version) for row in connection.execute(text(_VERSIONS))}


def read_fields(
    connection: Connection, names: Sequence[str] | None = None
) -> dict[str, FieldVoxels]:
    """Return fields of the current map by name, in their newest versions.

    Parameters
    ----------
    connection : Connection that sees the map
    names : sequence of str, optional
        Only these; by default all.

    Raises
    ------
    LookupError
        There is no field of a given name, or OpenVDB is not installed.
    ValueError
        A field has a value that is not finite.
    """
    known = [*read_field_versions(connection)]
    for name in names or ():
        if name not in known:
            near = suggestion(name, known, f"there are: {', '.join(known) or 'none'}")
            raise LookupError(f"there is no field named {name}{near}")
    wanted = known if names is None else [*dict.fromkeys(names)]
    if not wanted:
        return {}
    try:
        from semmap.fields.store import field_store
    except ImportError as error:
        raise LookupError(
            f"the map has fields ({', '.join(wanted)}), but they cannot be read ({error}); install "
            "semmap_vdb (scripts/setup), or leave the fields out (--no-fields)"
        ) from None
    found = {}
    for name in wanted:
        stored = field_store.load(connection, name)
        property = local_name(stored.property)
        try:
            found[name] = field_voxels(stored.grid, property, stored.about, stored.legend)
        except ValueError as error:
            raise ValueError(f"field {name}: {error}") from None
    return found
