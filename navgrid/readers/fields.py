"""Reads voxels for grids and costmaps: those of the map's fields, and those of its mirror.

Fields are stored by users, or live: the last ones of the sources of a running service, which it
keeps in the database every second.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from sqlalchemy import text

from navgrid.field_layer import FieldVoxels, field_voxels
from navgrid.policy import Policy
from semmap.geometry.voxels import Voxels
from semmap.query.map_handle import MapSource, open_feed
from semmap.query.snapshot import Snapshot
from semmap.snake_case import local_name
from semmap.suggestions import suggestion

LIVE = 60.0
"""Seconds since its last update for which the field of a source is live."""

_VERSIONS = """
SELECT f.name, f.id, f.version, f.property, v.answer,
       extract(epoch FROM statement_timestamp() - v.at)::float8 AS age FROM field f
JOIN field_version v ON v.field_id = f.id AND v.version = f.version
WHERE f.map_id = current_map() AND v.state IS NULL ORDER BY f.name
"""
"""The state of a mirror is not a field."""


_OF_SOURCES = """
SELECT m.key AS name, m.value::text::integer AS version,
       (SELECT o.property FROM field o WHERE o.map_id = f.map_id AND o.name = m.key) AS property,
       v.at >= now() - make_interval(secs => :live) AS live
FROM field f JOIN field_version v ON v.field_id = f.id AND v.version = f.version
CROSS JOIN LATERAL jsonb_each(v.state -> 'maps') m
WHERE f.map_id = current_map() AND f.property = 'urn:semmap:ontology#provides' ORDER BY m.key
"""
"""The record of a source names its last maps."""


def read_field_versions(seen: Snapshot, policy: Policy | None = None) -> dict[str, tuple[int, int]]:
    """Return the id and the newest version of each stored field of the current map, by name.

    The kept answers of queries are left out, except for as long as the policy lets them count.
    """
    keeps = (policy or Policy.default()).keeps
    return {
        row.name: (row.id, row.version)
        for row in seen.connection.execute(text(_VERSIONS))
        if not row.answer or row.age <= keeps(local_name(row.property))
    }


def read_live_versions(seen: Snapshot) -> dict[str, tuple[str, int]]:
    """Return the property and the newest version of each live field of a source, by name."""
    rows = seen.connection.execute(text(_OF_SOURCES), {"live": LIVE})
    return {row.name: (local_name(row.property), row.version) for row in rows if row.live}


def read_ended_fields(seen: Snapshot) -> list[str]:
    """Return the names of the fields of sources that are not live any more."""
    rows = seen.connection.execute(text(_OF_SOURCES), {"live": LIVE})
    return [row.name for row in rows if not row.live]


def read_fields(
    seen: Snapshot,
    names: Sequence[str] | None = None,
    *,
    live: bool = True,
    policy: Policy | None = None,
) -> dict[str, FieldVoxels]:
    """Return fields of the current map by name, in their newest versions.

    Parameters
    ----------
    names : sequence of str, optional
        Only these, live or ended; by default all that are stored or live, and of the kept answers
        of queries those that the policy lets count.
    live : bool
        Take the fields of sources, too.

    Raises
    ------
    LookupError
        There is no field of a given name, or OpenVDB is not installed.
    ValueError
        A field has a value that is not finite.
    """
    of_sources = seen.connection.execute(text(_OF_SOURCES), {"live": LIVE}).all() if live else []
    stored_now = {row.name for row in seen.connection.execute(text(_VERSIONS))}
    counting = read_field_versions(seen, policy)
    versions = dict.fromkeys(sorted(stored_now))
    versions |= {row.name: row.version for row in of_sources}
    ended = {row.name for row in of_sources if not row.live}
    known = [*versions]
    for name in names or ():
        if name not in known:
            near = suggestion(name, known, f"there are: {', '.join(known) or 'none'}")
            raise LookupError(f"there is no field named {name}{near}")
    data = stored_now - counting.keys()
    wanted = [n for n in known if n not in ended | data]
    wanted = wanted if names is None else [*dict.fromkeys(names)]
    if not wanted:
        return {}
    with _openvdb(f"the map has fields ({', '.join(wanted)})", "leave them out by fields=()"):
        from semmap.fields.store import field_store
    found = {}
    for name in wanted:
        stored = field_store.load(seen, name, versions[name])
        property = local_name(stored.property)
        try:
            found[name] = field_voxels(stored.grid, property, stored.about, stored.legend)
        except ValueError as error:
            raise ValueError(f"field {name}: {error}") from None
    return found


def read_mirror(source: MapSource, voxel_size: float = 0.05) -> dict[int, Voxels]:
    """Return the voxels of a map's objects, walls and doors by id: conservative ones, for grids.

    They contain each voxel of `voxel_size` metres that a mesh meets, and the inside of closed
    meshes: their cells contain those of `navgrid.slabs`, and exceed them by at most one voxel. The
    meshes are in them, for where an interval of heights ends within voxels.
    Point clouds, and voxels that were stated in place of a mesh, are those of the mirror, which is
    read where there are any. LookupError without OpenVDB, ValueError for too many voxels.
    """
    with _openvdb("the mirror has the voxels of the map", "take their meshes (no voxel_size=)"):
        from semmap.fields.regions.region_map import RegionMap
        from semmap.fields.store.reader import read_occupants, read_walls
        from semmap.fields.store.stated_voxels import read_stated
        from semmap.fields.store.voxel_mirror import VoxelMirror
    with open_feed(source).snapshot() as seen:
        occupants = [*read_occupants(seen), *read_walls(seen)]
        stated = {s.id for s in read_stated(seen, None, voxel_size) if s.role == "object"}
    drawn = [o for o in occupants if o.points is None and o.id not in stated]
    cover = RegionMap(voxel_size)
    regions = [(o.id, region) for o in drawn for region in o.cover(voxel_size)]
    names: dict[object, str] = {o.id: o.name for o in drawn}
    left_out = {names[n]: why for n, why in cover.insert_possible(regions).items()}
    found = {o.id: cover.voxels(o.id) for o in drawn}
    meshes = {o.id: o.triangles for o in drawn}
    others = {o.id for o in occupants} - found.keys() | stated
    if others:
        mirror = VoxelMirror.resume(source.engine, source.name, voxel_size)
        mirror.catch_up()
        left_out |= mirror.left_out
        for kept in (mirror.regions, mirror.walls):
            found |= {n: kept.voxels(n) for n in others.intersection(kept.entities())}
    for name, reason in left_out.items():
        raise ValueError(f"{name} has no voxels: {reason}; take larger voxels, or the meshes")
    return {n: Voxels(voxel_size, v.astype(np.int64), meshes.get(n)) for n, v in found.items()}


@contextmanager
def _openvdb(what: str, otherwise: str) -> Iterator[None]:
    """Explain a missing OpenVDB."""
    try:
        yield
    except ImportError as error:
        raise LookupError(
            f"{what}, but they cannot be read ({error}); install semmap_vdb (scripts/setup), or "
            f"{otherwise}"
        ) from None
