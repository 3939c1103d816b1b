"""A region map that follows the map in the database, through restarts of either.

Only what was imported, moved or deleted is voxelised again. A notification wakes the mirror; it
reads the changes by a cursor, so that a lost notification does no harm.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Set
from contextlib import suppress
from typing import Any

from sqlalchemy import Engine
from sqlalchemy.exc import DBAPIError

from semmap.database.maps import see_map
from semmap.fields.regions.region_map import RegionMap, Role
from semmap.fields.regions.shaped_region import Region
from semmap.fields.store import field_store
from semmap.fields.store.mirror_state import (
    MirrorState,
    Reasons,
    field_name,
    load_state,
    load_walls,
    origin,
    walls_name,
)
from semmap.fields.store.reader import (
    Occupant,
    read_agents,
    read_homes,
    read_occupants,
    read_timed_regions,
    read_walls,
    read_zones,
)
from semmap.fields.store.stated_voxels import read_stated
from semmap.query.change_feed import ChangeFeed

PROPERTY = "urn:semmap:ontology#occupiedBy"

OnChange = Callable[[set[int]], None]


class VoxelMirror(MirrorState):
    """The voxels of the objects, agents, rooms and regions of a map; the entities are ids.

    A room is its space. The walls of rooms that have a mesh, and the leaves of doors, are a region
    map of their own: an entity has one region in a map. Without a name, it is the chosen or only
    map.

    Attributes
    ----------
    regions : may be read at any time. An entity that moves is absent for a moment, and never
        incomplete
    walls : the shells of rooms, and the leaves of doors, open ones included
    names, roles : of each id
    spaces : the ids of rooms, regions and other parts of space
    views : the agent of each entity that is a field of view
    maps : maps of sources; the mirror itself puts none there
    """

    def __init__(
        self, engine: Engine, map_name: str | None = None, voxel_size: float = 0.05
    ) -> None:
        super().__init__(RegionMap(voxel_size))
        self.walls = RegionMap(voxel_size)
        self._walls_reasons: Reasons = {}
        self._engine = engine
        self._feed = ChangeFeed(engine, map_name)
        self._unsaved = False
        self._lock = threading.Lock()  # regions, names and cursor change together

    @classmethod
    def resume(
        cls, engine: Engine, map_name: str | None = None, voxel_size: float = 0.05
    ) -> VoxelMirror:
        """Return a mirror that continues from the state that was saved last.

        `catch_up` reads what changed since, or the whole map if the state cannot be used: see
        `load_state`.
        """
        mirror = cls(engine, map_name, voxel_size)
        with mirror._feed.snapshot() as seen:
            state = load_state(seen, voxel_size)
            walls = None if state is None else load_walls(seen, voxel_size, state.cursor)
        if state is not None and walls is not None:
            vars(mirror).update(vars(state))
            mirror.walls, mirror._walls_reasons = walls
            mirror._feed.cursor = state.cursor
        return mirror

    def save(self) -> int:
        """Store the state in place of the former one; return the number of its version.

        Raises LookupError: `catch_up` was not called yet, or the map was deleted.
        """
        with self._lock:
            if self._feed.cursor is None:
                raise LookupError("the mirror has not read its map yet: call catch_up first")
            voxels, walls = self.own_state(), self.walls.state()
            names = {each: name for each, name in dict(self.names).items() if isinstance(each, int)}
            state = {
                "cursor": self._feed.cursor,
                "names": names,
                "roles": {each: self.roles[each] for each in names},
                "homes": dict(self.homes),
                "zones": dict(self.zones),
                "stated": sorted(self.stated),
                "left_out": dict(self.reasons),
            }
            of_walls = {"cursor": self._feed.cursor, "left_out": dict(self._walls_reasons)}
            self._unsaved = False
        size = self.regions.voxel_size
        try:
            with self._engine.begin() as connection:
                self._feed.map_name = see_map(connection, self._feed.map_name)
                state["by"] = origin(connection)
                for name, (grid, sets), kept in (
                    (walls_name(size), walls, of_walls),
                    (field_name(size), voxels, state),
                ):
                    number = field_store.save(
                        connection, name, grid, property=PROPERTY, legend=sets, state=kept
                    )
                    field_store.prune(connection, name, 1)
        except BaseException:
            self._unsaved = True
            raise
        return number

    @property
    def left_out(self) -> dict[str, str]:
        """For each entity without voxels the reason: it would have more than limits allow."""
        return dict([*self.reasons.values(), *self._walls_reasons.values()])

    def catch_up(self) -> set[int]:
        """Read what changed since the last call, at first all; return the ids that changed.

        A call that fails changes nothing: the next one reads the same changes again.
        """
        with self._lock:
            with self._feed.look() as look:
                changed = None if look.changed is None else set(look.changed)
                if changed is None or changed:
                    occupants = read_occupants(look.seen, changed)
                    walls = read_walls(look.seen, changed)
                    agents = read_agents(look.seen, changed)
                    again = changed and changed | read_timed_regions(look.seen)
                    zones = read_zones(look.seen, again)
                    homes = read_homes(look.seen, self._to_house(changed, zones.keys()))
                    stated = read_stated(look.seen, changed, self.regions.voxel_size)
            if changed is not None and not changed:
                self._feed.take_in(look)
                return set()
            size, kept_zones = self.regions.voxel_size, {n: z.as_json() for n, z in zones.items()}
            if again is not None:
                kept_zones |= {n: z for n, z in self.zones.items() if n not in again}
            stale = self._stale(changed, kept_zones) | {each.id for each in stated}
            stale |= self.stated & (changed or set())
            found: dict[int, tuple[str, Role, list[Region]]] = {
                **{each.id: (each.name, each.role, each.regions(size)) for each in occupants},
                **{each.id: (each.name, "agent", [each.body]) for each in agents},
                **{n: (z.name, z.kind, z.regions(size)) for n, z in zones.items() if n in stale},
                **{each.id: (each.name, each.role, [each.points]) for each in stated},
            }
            self.stated = (self.stated - stale) | {each.id for each in stated}
            with self.changing:
                self._replace(stale | set(found), found)
            self.zones = kept_zones
            housed = {n for n, home in homes.items() if self.homes.get(n) != home}
            self.homes = {n: self.homes[n] for n in self.homes.keys() - stale} | homes
            self._rebuild(changed, walls)
            self._feed.take_in(look)
            self._unsaved = True
            return stale | set(found) | housed

    def _to_house(self, changed: set[int] | None, zones: Set[int]) -> set[int] | None:
        """Return the entities whose room may have changed; None for all, as where rooms changed."""
        return None if changed is None or changed & (self.zones.keys() | zones) else changed

    def _replace(self, changed: set[int], found: dict[int, tuple[str, Role, list[Region]]]) -> None:
        """Replace entities by those that were found; what sources see of agents stays."""
        for number in changed:
            self.own_regions(number).remove(number)
            for former in (self.names, self.roles, self.reasons):
                former.pop(number, None)
        for number in self.seen & (changed - found.keys()):
            self._end_seen(number)
        reasons: dict[Any, str] = {}
        for on, these in (
            (self.regions, found.keys() - self.seen),
            (self.own, found.keys() & self.seen),
        ):
            reasons |= on.insert_possible(
                [(number, region) for number in these for region in found[number][2]]
            )
        for number, (name, role, _) in found.items():
            if number in reasons:
                self.reasons[number] = (name, reasons[number])
                self._end_seen(number)
            else:
                self.names[number], self.roles[number] = name, role

    def _end_seen(self, number: int) -> None:
        if number in self.seen:
            self.seen.remove(number)
            self.regions.remove(number)

    def _rebuild(self, changed: set[int] | None, walls: list[Occupant]) -> None:
        """Replace the walls of the rooms and doors that changed; all of them for None."""
        if changed is None:
            self.walls = RegionMap(self.walls.voxel_size)
            self._walls_reasons = {}
        for number in changed or ():
            self.walls.remove(number)
            self._walls_reasons.pop(number, None)
        reasons = self.walls.insert_possible(
            [(each.id, region) for each in walls for region in each.regions(self.walls.voxel_size)]
        )
        self._walls_reasons |= {
            each.id: (each.name, reasons[each.id]) for each in walls if each.id in reasons
        }

    def _stale(self, changed: set[int] | None, zones: dict[int, list[Any]]) -> set[int]:
        """Return the entities whose voxels are to be removed or replaced."""
        if changed is None:
            own = {each for each in dict(self.names) if isinstance(each, int)}
            return own | self.reasons.keys() | zones.keys()
        either = self.zones.keys() | zones.keys()
        return (changed - either) | {n for n in either if self.zones.get(n) != zones.get(n)}

    def follow(
        self,
        stop: threading.Event,
        on_change: OnChange | None = None,
        *,
        patience: float = 0.2,
        save_every: float | None = None,
    ) -> None:
        """Follow the database until `stop` is set, through its restarts.

        `on_change` gets the ids that changed. `patience` is the seconds between checks of `stop`,
        `save_every` the least seconds between saves of a changed state; never if not given.
        """
        saved = -float("inf")

        def wake(payloads: tuple[str, ...] | None) -> None:
            nonlocal saved
            if payloads is None or payloads:
                changed = self.catch_up()
                if changed and on_change is not None:
                    on_change(changed)
            if save_every is not None and self._unsaved and time.monotonic() >= saved + save_every:
                self._save_if_there_is_a_map()
                saved = time.monotonic()

        self._feed.follow(stop, wake, patience=patience)
        if save_every is not None and self._unsaved:
            self.try_to_save()

    def try_to_save(self) -> None:
        """Store the state; without the rights or a server, the next process reads the whole map."""
        with suppress(DBAPIError):
            self._save_if_there_is_a_map()

    def _save_if_there_is_a_map(self) -> None:
        with suppress(LookupError):  # it was dropped, and may be imported again
            self.save()
