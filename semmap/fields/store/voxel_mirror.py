"""A region map that follows the map in the database, through restarts of either.

Only entities that were imported, moved or deleted are voxelised again. A notification wakes the
mirror; it reads the changes from the history by a cursor, so that a lost notification does no harm.
The state can be stored in the database with that cursor, for another process to continue.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import version

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.regions.region_map import RegionMap
from semmap.fields.sources import Zones, ZoneSource
from semmap.fields.store import field_store
from semmap.fields.store.reader import (
    read_map_vocabulary,
    read_occupants,
    read_server_id,
    read_zones,
)
from semmap.query.change_feed import ChangeFeed, reaches_back
from semmap.query.maps import see_map
from semmap_vdb import Int32Grid

__all__ = ["VoxelMirror"]

PROPERTY = "urn:semmap:ontology#occupiedBy"

OnChange = Callable[[set[int]], None]


class VoxelMirror:
    """The voxels of the entities of a map; the entities are ids.

    Parameters
    ----------
    engine : Engine
        Of the database.
    map_name : str, optional
        If not given, the chosen or only map, when changes are read first.
    voxel_size : float
        Metres.

    Attributes
    ----------
    regions : RegionMap
        May be read at any time. An entity that moves is absent for a moment, and never incomplete.
    names : dict
        The name of each id.
    maps : MapBuffer
        The zones: a map for each room and region that is valid.
    """

    def __init__(
        self, engine: Engine, map_name: str | None = None, voxel_size: float = 0.05
    ) -> None:
        self.regions = RegionMap(voxel_size)
        self.names: dict[int, str] = {}
        self._left_out: dict[int, tuple[str, str]] = {}  # name and reason by id
        self.maps = MapBuffer()
        self._zones = ZoneSource(read_map_vocabulary(), voxel_size=voxel_size)
        self._engine = engine
        self._feed = ChangeFeed(engine, map_name)
        self._has_zones = False
        self._unsaved = False
        self._lock = threading.Lock()  # regions, names and cursor change together

    @classmethod
    def resume(
        cls, engine: Engine, map_name: str | None = None, voxel_size: float = 0.05
    ) -> VoxelMirror:
        """Return a mirror that continues from the state that was saved last.

        `catch_up` reads what changed since. It reads the whole map if the state cannot be used:
        there is none of this voxel size, it is from another release of semmap or from another
        server, or the history since then was deleted.
        """
        mirror = cls(engine, map_name, voxel_size)
        with mirror._feed.snapshot() as connection:
            try:
                stored = field_store.load(connection, mirror._field)
                state = stored.state or {}
                if state.get("by") != _origin(connection):
                    return mirror
                if not reaches_back(connection, state["cursor"]):
                    return mirror
                assert isinstance(stored.grid, Int32Grid)
                mirror.regions = RegionMap.from_state(stored.grid, stored.legend or {})
            except (LookupError, ValueError):
                return mirror
        mirror.names = {int(number): name for number, name in state["names"].items()}
        mirror._left_out = {
            int(number): (name, reason)
            for number, (name, reason) in state.get("left_out", {}).items()
        }
        mirror._feed.cursor = state["cursor"]
        return mirror

    def save(self) -> int:
        """Store the state in the database, in place of the former one.

        Returns
        -------
        int
            The number of its version.

        Raises
        ------
        LookupError
            `catch_up` was not called yet, or the map was deleted.
        """
        with self._lock:
            if self._feed.cursor is None:
                raise LookupError("the mirror has not read its map yet: call catch_up first")
            grid, sets = self.regions.state()
            names, since = dict(self.names), self._feed.cursor
            left_out = dict(self._left_out)
            self._unsaved = False
        try:
            with self._engine.begin() as connection:
                self._feed.map_name = see_map(connection, self._feed.map_name)
                state = {
                    "by": _origin(connection),
                    "cursor": since,
                    "names": names,
                    "left_out": left_out,
                }
                number = field_store.save(
                    connection, self._field, grid, property=PROPERTY, legend=sets, state=state
                )
                field_store.prune(connection, self._field, 1)
        except BaseException:
            self._unsaved = True
            raise
        return number

    @property
    def left_out(self) -> dict[str, str]:
        """For each entity without voxels the reason: it would have more than limits allow."""
        return dict(self._left_out.values()) | self._zones.left_out

    def catch_up(self) -> set[int]:
        """Read what changed since the last call; at the first call, the whole map.

        A call that fails changes nothing: the next one reads the same changes again.

        Returns
        -------
        set of int
            The ids of the entities that changed.
        """
        with self._lock:
            with self._feed.look() as look:
                changed = None if look.changed is None else set(look.changed)
                nothing = changed is not None and not changed
                occupants = [] if nothing else read_occupants(look.connection, changed)
                zones = None if nothing and self._has_zones else tuple(read_zones(look.connection))
            size = self.regions.voxel_size
            regions = {each.id: each.regions(size) for each in occupants}
            gone = set(self.names) - set(regions) if changed is None else changed - set(regions)
            for number in gone | set(regions):
                self.regions.remove(number)
                self.names.pop(number, None)
                self._left_out.pop(number, None)
            reasons = self.regions.insert_possible(
                [(number, region) for number, each in regions.items() for region in each]
            )
            for each in occupants:
                if each.id in reasons:
                    self._left_out[each.id] = (each.name, reasons[each.id])
                else:
                    self.names[each.id] = each.name
            if zones is not None:
                drawn = self._zones(Zones(zones, datetime.now(UTC)))  # unchanged zones are reused
                if drawn != list(self.maps.now()):
                    self.maps.put("zones", drawn)
                self._has_zones = True
            self._feed.take_in(look)
            self._unsaved = self._unsaved or not nothing
            return gone | set(regions)

    def follow(
        self,
        stop: threading.Event,
        on_change: OnChange | None = None,
        *,
        patience: float = 0.2,
        save_every: float | None = None,
    ) -> None:
        """Follow the database until `stop` is set, through its restarts.

        Parameters
        ----------
        stop : ends the call
        on_change : called with the ids that changed, after the mirror has read them
        patience : seconds between checks of `stop`, and before another attempt to connect
        save_every : the least seconds between saves of a changed state; never if not given
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
            with suppress(DBAPIError):  # without a server, the next process reads the whole map
                self._save_if_there_is_a_map()

    def _save_if_there_is_a_map(self) -> None:
        with suppress(LookupError):  # it was dropped, and may be imported again
            self.save()

    @property
    def _field(self) -> str:
        return f"occupied {self.regions.voxel_size} m"


def _origin(connection: Connection) -> list[str]:
    """Return release and server: the state of another release may have other voxels of a mesh."""
    return [version("semmap"), read_server_id(connection)]
