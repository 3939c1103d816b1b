"""The state of a mirror: one grid for all entities, as the database keeps it between processes.

Why: docs/decisions/the_state_of_a_mirror_is_its_grid_of_set_numbers_the_sets_and_a_cursor.md
"""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.regions.region_map import RegionMap, Role, SpacesOf
from semmap.fields.store import field_store
from semmap.fields.store.statements import Connection, run
from semmap.query.snapshot import Snapshot
from semmap_vdb import Int32Grid

FORMAT = "4"
"""Of the state in the database."""


@dataclass(eq=False)
class MirrorState:
    """The entities of a map on one grid; those of the map are ids, those of sources names.

    `views` has the agent of each field of view; `left_out` name and reason for each id with too
    many voxels; `zones` what the voxels of rooms and regions were made of, as JSON; `stated` the
    ids whose voxels an update stated. The `cursor` of an empty state is None.
    """

    regions: RegionMap
    names: dict[Any, str] = field(default_factory=dict)
    roles: dict[Any, Role] = field(default_factory=dict)
    views: dict[Any, str] = field(default_factory=dict)
    left_out: dict[int, tuple[str, str]] = field(default_factory=dict)
    zones: dict[int, list[Any]] = field(default_factory=dict)
    stated: set[int] = field(default_factory=set)
    cursor: str | None = None
    maps: MapBuffer = field(default_factory=MapBuffer)

    @property
    def spaces(self) -> SpacesOf:
        """The entities that are parts of space."""
        return SpacesOf(self.roles)


def field_name(voxel_size: float) -> str:
    """Return the name of the field that keeps the state for a size of voxels."""
    return f"occupied {voxel_size} m"


def walls_name(voxel_size: float) -> str:
    """Return the name of the field that keeps the walls for a size of voxels."""
    return f"walls {voxel_size} m"


def load_walls(
    seen: Snapshot, voxel_size: float, cursor: str | None
) -> tuple[RegionMap, dict[int, tuple[str, str]]] | None:
    """Return the walls of a state with this cursor, and name and reason of those without voxels."""
    try:
        stored = field_store.load(seen, walls_name(voxel_size))
        kept = stored.state or {}
        if kept.get("cursor") != cursor:
            return None
        assert isinstance(stored.grid, Int32Grid)
        walls = RegionMap.from_state(stored.grid, stored.legend or {})
    except (LookupError, ValueError):
        return None
    return walls, {int(n): (name, reason) for n, (name, reason) in kept["left_out"].items()}


def load_state(seen: Snapshot, voxel_size: float) -> MirrorState | None:
    """Return the state that was saved last, or None if it cannot be used.

    That is where there is none of this voxel size, where it is from another release of semmap or
    from another server, or where the history since then was deleted.
    """
    try:
        stored = field_store.load(seen, field_name(voxel_size))
        kept = stored.state or {}
        if kept.get("by") != origin(seen.session):
            return None
        reaches = run(
            seen.session, "SELECT reaches_back(%(since)s) AS so", {"since": kept["cursor"]}
        )
        if not reaches[0].so:
            return None
        assert isinstance(stored.grid, Int32Grid)
        regions = RegionMap.from_state(stored.grid, stored.legend or {})
    except (LookupError, ValueError):
        return None
    for entity in regions.entities():
        if not isinstance(entity, int):  # what sources saw then
            regions.remove(entity)
    return MirrorState(
        regions,
        {int(number): name for number, name in kept["names"].items()},
        {int(number): role for number, role in kept["roles"].items()},
        left_out={int(n): (name, reason) for n, (name, reason) in kept["left_out"].items()},
        zones={int(number): zone for number, zone in kept["zones"].items()},
        stated=set(kept["stated"]),
        cursor=kept["cursor"],
    )


def is_current(seen: Snapshot, state: MirrorState) -> bool:
    """Whether the map has not changed since a state, and no region begins or ends in time."""
    (row,) = run(
        seen.session,
        "SELECT EXISTS (SELECT FROM changes_since(%(since)s) WHERE map_id = current_map()) "
        "OR EXISTS (SELECT FROM region g JOIN entity e ON e.id = g.entity_id "
        "WHERE e.map_id = current_map() AND g.valid IS NOT NULL) AS changed",
        {"since": state.cursor},
    )
    return not row.changed


def origin(connection: Connection) -> list[str]:
    """Return release, format and server: another release may make other voxels of a mesh."""
    (row,) = run(connection, "SELECT system_identifier::text AS server FROM pg_control_system()")
    return [version("semmap"), FORMAT, row.server]
