"""The state of a mirror: one grid for all entities, as the database keeps it between processes.

Why: docs/decisions/the_state_of_a_mirror_is_its_grid_of_set_numbers_the_sets_and_a_cursor.md
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.regions.region_map import NamedRegionMap, RegionMap
from semmap.fields.store import field_store
from semmap.fields.store.run_statement import Connection, run
from semmap.query.snapshot import Snapshot
from semmap_vdb import Int32Grid

FORMAT = "5"
"""Of the state in the database."""

Reasons = dict[int, tuple[str, str]]
"""Name and reason for each id without voxels: it would have more than limits allow."""


@dataclass(eq=False)
class MirrorState(NamedRegionMap):
    """The entities of a map on one grid.

    `zones` has what the voxels of rooms and regions were made of, as JSON; `stated` the ids whose
    voxels an update stated. The `cursor` of an empty state is None.
    """

    reasons: Reasons = field(default_factory=dict)
    zones: dict[int, list[Any]] = field(default_factory=dict)
    stated: set[int] = field(default_factory=set)
    cursor: str | None = None
    maps: MapBuffer = field(default_factory=MapBuffer)


def field_name(voxel_size: float) -> str:
    """Return the name of the field that keeps the state for a size of voxels."""
    return f"occupied {voxel_size} m"


def walls_name(voxel_size: float) -> str:
    """Return the name of the field that keeps the walls for a size of voxels."""
    return f"walls {voxel_size} m"


def load_walls(
    seen: Snapshot, voxel_size: float, cursor: str | None
) -> tuple[RegionMap, Reasons] | None:
    """Return the walls that were saved with the state of a cursor."""
    found = _load(seen, walls_name(voxel_size), lambda kept: kept["cursor"] == cursor)
    return None if found is None else (found[0], _reasons(found[1]))


def load_state(seen: Snapshot, voxel_size: float) -> MirrorState | None:
    """Return the state that was saved last, or None if it cannot be used.

    That is where there is none of this voxel size, where it is from another release of semmap or
    from another server, or where the history since then was deleted.
    """

    def is_usable(kept: dict[str, Any]) -> bool:
        since = {"since": kept["cursor"]}
        return kept["by"] == origin(seen.session) and bool(
            run(seen.session, "SELECT reaches_back(%(since)s) AS so", since)[0].so
        )

    found = _load(seen, field_name(voxel_size), is_usable)
    if found is None:
        return None
    regions, kept = found
    for entity in regions.entities():
        if not isinstance(entity, int):  # what sources saw then
            regions.remove(entity)
    return MirrorState(
        regions,
        {int(number): name for number, name in kept["names"].items()},
        {int(number): role for number, role in kept["roles"].items()},
        homes={int(number): room for number, room in kept["homes"].items()},
        reasons=_reasons(kept),
        zones={int(number): zone for number, zone in kept["zones"].items()},
        stated=set(kept["stated"]),
        cursor=kept["cursor"],
    )


def _load(
    seen: Snapshot, name: str, is_usable: Callable[[dict[str, Any]], bool]
) -> tuple[RegionMap, dict[str, Any]] | None:
    try:
        stored = field_store.load(seen, name)
        if stored.state is None or not is_usable(stored.state):
            return None
        assert isinstance(stored.grid, Int32Grid)
        return RegionMap.from_state(stored.grid, stored.legend or {}), stored.state
    except (LookupError, ValueError):
        return None


def _reasons(kept: dict[str, Any]) -> Reasons:
    return {int(n): (name, reason) for n, (name, reason) in kept["left_out"].items()}


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
