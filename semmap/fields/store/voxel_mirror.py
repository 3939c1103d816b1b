"""A region map that follows the map in the database, through restarts of either.

Only what was imported, moved or deleted is voxelised again. A notification wakes the mirror; it
reads the changes by a cursor, so that a lost notification does no harm.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from sqlalchemy import Engine
from sqlalchemy.exc import DBAPIError

from semmap.database.maps import see_map
from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.regions.region_map import RegionMap, Role, SpacesOf
from semmap.fields.regions.shapes import Region
from semmap.fields.sources.percepts import Zone
from semmap.fields.store import field_store
from semmap.fields.store.agents import StandingAgent, read_agents
from semmap.fields.store.mirror_state import (
    field_name,
    load_state,
    load_walls,
    origin,
    walls_name,
)
from semmap.fields.store.reader import (
    Occupant,
    read_occupants,
    read_walls,
    read_zone_ids,
    read_zones,
)
from semmap.fields.store.stated_voxels import StatedVoxels, read_stated
from semmap.query.change_feed import ChangeFeed
from semmap.query.snapshot import Snapshot

PROPERTY = "urn:semmap:ontology#occupiedBy"

OnChange = Callable[[set[int]], None]


class VoxelMirror:
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
        self.regions = RegionMap(voxel_size)
        self.walls = RegionMap(voxel_size)
        self.names: dict[Any, str] = {}
        self.roles: dict[Any, Role] = {}
        self.spaces = SpacesOf(self.roles)
        self.views: dict[Any, str] = {}
        self._left_out: dict[int, tuple[str, str]] = {}  # name and reason by id
        self._walls_left_out: dict[int, tuple[str, str]] = {}
        self.maps = MapBuffer()
        self._zones: dict[int, Zone] | None = None  # as they were inserted last
        self._stated: set[int] = set()
        self._engine = engine
        self._feed = ChangeFeed(engine, map_name)
        self._unsaved = False
        self._lock = threading.Lock()  # regions, names and cursor change together

    @property
    def stated(self) -> frozenset[int]:
        """The ids of the entities whose voxels were stated, in place of those of their meshes."""
        return frozenset(self._stated)

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
            mirror.regions, mirror.names = state.regions, state.names
            mirror.walls, mirror._walls_left_out = walls
            mirror.roles.update(state.roles)
            mirror._left_out = state.left_out
            mirror._stated = state.stated
            mirror._zones = {n: Zone.from_json(zone) for n, zone in state.zones.items()}
            mirror._feed.cursor = state.cursor
        return mirror

    def save(self) -> int:
        """Store the state in place of the former one; return the number of its version.

        Raises LookupError: `catch_up` was not called yet, or the map was deleted.
        """
        with self._lock:
            if self._feed.cursor is None:
                raise LookupError("the mirror has not read its map yet: call catch_up first")
            grid, sets = self.regions.state()
            walls, wall_sets = self.walls.state()
            walls_left_out = dict(self._walls_left_out)
            names = {each: name for each, name in dict(self.names).items() if isinstance(each, int)}
            roles, since = {each: self.roles[each] for each in names}, self._feed.cursor
            left_out, stated = dict(self._left_out), sorted(self._stated)
            zones = {number: zone.as_json() for number, zone in (self._zones or {}).items()}
            self._unsaved = False
        try:
            with self._engine.begin() as connection:
                self._feed.map_name = see_map(connection, self._feed.map_name)
                state = {
                    "by": origin(connection),
                    "cursor": since,
                    "names": names,
                    "roles": roles,
                    "zones": zones,
                    "stated": stated,
                    "left_out": left_out,
                }
                number = field_store.save(
                    connection, self._field, grid, property=PROPERTY, legend=sets, state=state
                )
                field_store.prune(connection, self._field, 1)
                beside = walls_name(self.regions.voxel_size)
                field_store.save(
                    connection,
                    beside,
                    walls,
                    property=PROPERTY,
                    legend=wall_sets,
                    state={"cursor": since, "left_out": walls_left_out},
                )
                field_store.prune(connection, beside, 1)
        except BaseException:
            self._unsaved = True
            raise
        return number

    @property
    def left_out(self) -> dict[str, str]:
        """For each entity without voxels the reason: it would have more than limits allow."""
        return dict([*self._left_out.values(), *self._walls_left_out.values()])

    def catch_up(self) -> set[int]:
        """Read what changed since the last call, at first all; return the ids that changed.

        A call that fails changes nothing: the next one reads the same changes again.
        """
        with self._lock:
            with self._feed.look() as look:
                changed = None if look.changed is None else set(look.changed)
                nothing = changed is not None and not changed and self._zones is not None
                occupants = [] if nothing else read_occupants(look.seen, changed)
                walls = [] if nothing else read_walls(look.seen, changed)
                agents = [] if nothing else read_agents(look.seen, changed)
                zones = self._zones or {}
                stated: list[StatedVoxels] = []
                if not nothing:
                    zones = read_zones_by_id(look.seen)
                    stated = read_stated(look.seen, changed, self.regions.voxel_size)
            stale = self._stale(changed, zones) | {each.id for each in stated}
            stale |= self._stated & (changed or set())
            regions = self._regions_of(occupants, agents)
            regions |= {n: zone_regions(z, self.regions) for n, z in zones.items() if n in stale}
            roles: dict[int, Role] = {n: zone.kind for n, zone in zones.items()}
            roles |= dict.fromkeys((each.id for each in agents), "agent")
            names = {n: zone.name for n, zone in zones.items()}
            names |= {each.id: each.name for each in occupants} | {
                each.id: each.name for each in agents
            }
            for number in stale | set(regions):
                self.regions.remove(number)
                for former in (self.names, self.roles, self._left_out):
                    former.pop(number, None)
            for each in stated:
                regions[each.id] = [each.points]
                names[each.id], roles[each.id] = each.name, each.role
            self._stated = (self._stated - stale) | {each.id for each in stated}
            reasons = self.regions.insert_possible(
                [(number, region) for number, each in regions.items() for region in each]
            )
            for number in regions:
                if number in reasons:
                    self._left_out[number] = (names[number], reasons[number])
                else:
                    self.names[number] = names[number]
                    self.roles[number] = roles.get(number, "object")
            self._zones = zones
            self._rebuild(changed, walls)
            self._feed.take_in(look)
            self._unsaved = self._unsaved or not nothing
            return stale | set(regions)

    def _rebuild(self, changed: set[int] | None, walls: list[Occupant]) -> None:
        """Replace the walls of the rooms and doors that changed; all of them for None."""
        if changed is None:
            self.walls = RegionMap(self.walls.voxel_size)
            self._walls_left_out = {}
        for number in changed or ():
            self.walls.remove(number)
            self._walls_left_out.pop(number, None)
        reasons = self.walls.insert_possible(
            [(each.id, region) for each in walls for region in each.regions(self.walls.voxel_size)]
        )
        self._walls_left_out |= {
            each.id: (each.name, reasons[each.id]) for each in walls if each.id in reasons
        }

    def _stale(self, changed: set[int] | None, zones: dict[int, Zone]) -> set[int]:
        """Return the entities whose voxels are to be removed or replaced."""
        if changed is None:
            own = {each for each in dict(self.names) if isinstance(each, int)}
            return own | self._left_out.keys() | zones.keys()
        former = self._zones or {}
        either = former.keys() | zones.keys()
        return (changed - either) | {n for n in either if former.get(n) != zones.get(n)}

    def _regions_of(
        self, occupants: list[Occupant], agents: list[StandingAgent]
    ) -> dict[int, list[Region]]:
        size = self.regions.voxel_size
        regions = {each.id: each.regions(size) for each in occupants}
        return regions | {each.id: [each.body] for each in agents}

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

    @property
    def _field(self) -> str:
        return field_name(self.regions.voxel_size)


def read_zones_by_id(seen: Snapshot) -> dict[int, Zone]:
    """Return the rooms and regions of the current map that are valid now, by their ids."""
    number = read_zone_ids(seen)
    return {number[zone.name]: zone for zone in read_zones(seen)}


def zone_regions(zone: Zone, regions: RegionMap) -> list[Region]:
    """Return the prism of a zone."""
    from semmap.fields.sources.zones import prism  # it loads what only a changed zone needs

    return prism(zone, regions.voxel_size)
