"""A region map that follows the map in the database, through restarts of either.

Entities that were imported, moved or deleted are voxelised anew, and only they. A NOTIFY wakes the
mirror; what changed it reads from the history by a cursor, so that a message missed is not lost.
Its state can be kept in the database with that cursor, for another process to go on from there.
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

from semmap.fields.store import field_store
from semmap.fields.maps.map_buffer import Maps
from semmap.fields.regions.region_map import RegionMap
from semmap.fields.store.reader import (
    read_occupants,
    read_vocabulary_of_map,
    read_zones,
    server,
)
from semmap.fields.sources import Zones, ZoneSource
from semmap.query.change_feed import ChangeFeed, reaches_back
from semmap.query.maps import see_map
from semmap_vdb import Int32Grid

__all__ = ["Mirror"]

PROPERTY = "urn:semmap:ontology#occupiedBy"

Heard = Callable[[set[int]], None]


class Mirror:
    """Which entities of a map are where, as voxels; entities are told by their ids.

    Parameters
    ----------
    map_name : str, optional
        The newest map if not given, at the first look.
    voxel_size : float
        Metres.

    Attributes
    ----------
    regions : RegionMap
        Readers may ask it at any time. A thing that moves is not there for a moment, never half.
    names : dict
        The name of each id.
    maps : Maps
        The zones: a map of each room and region that holds.
    """

    def __init__(
        self, engine: Engine, map_name: str | None = None, voxel_size: float = 0.05
    ) -> None:
        self.regions = RegionMap(voxel_size)
        self.names: dict[int, str] = {}
        self._left_out: dict[int, tuple[str, str]] = {}  # name and reason by id
        self.maps = Maps()
        self._zones = ZoneSource(read_vocabulary_of_map(), voxel_size=voxel_size)
        self._engine = engine
        self._feed = ChangeFeed(engine, map_name)
        self._has_zones = False
        self._unsaved = False
        self._lock = threading.Lock()  # regions, names and cursor change together

    @classmethod
    def resume(
        cls, engine: Engine, map_name: str | None = None, voxel_size: float = 0.05
    ) -> Mirror:
        """A mirror that goes on from the state last saved, and catches up what changed since.

        Where there is none that it can go on from, it begins anew at its first look: none of this
        voxel size, one by another release of semmap, on another server, or from before the history
        begins.
        """
        mirror = cls(engine, map_name, voxel_size)
        with mirror._feed.snapshot() as connection:
            try:
                kept = field_store.load(connection, mirror._field)
                state = kept.state or {}
                if state.get("by") != _by(connection):
                    return mirror
                if not reaches_back(connection, state["cursor"]):
                    return mirror
                assert isinstance(kept.grid, Int32Grid)
                mirror.regions = RegionMap.from_state(kept.grid, kept.legend or {})
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
        """Keep the state in place of the one before; the number of its version.

        Raises
        ------
        LookupError
            It has not looked yet, or its map is gone.
        """
        with self._lock:
            if self._feed.cursor is None:
                raise LookupError("a mirror that has not looked has no state: catch_up first")
            grid, sets = self.regions.state()
            names, since = dict(self.names), self._feed.cursor
            left_out = dict(self._left_out)
            self._unsaved = False
        try:
            with self._engine.begin() as connection:
                self._feed.map_name = see_map(connection, self._feed.map_name)
                state = {
                    "by": _by(connection),
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
        """By name, why an entity has no voxels: it would have more than limits allow."""
        return dict(self._left_out.values()) | self._zones.left_out

    def catch_up(self) -> set[int]:
        """Take in what changed since the last time, all the first time; the ids that did.

        A look that fails changes nothing: the next one sees the same changes again.
        """
        with self._lock:
            with self._feed.look() as look:
                changed = None if look.changed is None else set(look.changed)
                nothing = changed is not None and not changed
                things = [] if nothing else read_occupants(look.connection, changed)
                zones = None if nothing and self._has_zones else tuple(read_zones(look.connection))
            regions = {thing.id: thing.regions(self.regions.voxel_size) for thing in things}
            gone = set(self.names) - set(regions) if changed is None else changed - set(regions)
            for number in gone | set(regions):
                self.regions.remove(number)
                self.names.pop(number, None)
                self._left_out.pop(number, None)
            reasons = self.regions.insert_possible(
                [(number, region) for number, each in regions.items() for region in each]
            )
            for thing in things:
                if thing.id in reasons:
                    self._left_out[thing.id] = (thing.name, reasons[thing.id])
                else:
                    self.names[thing.id] = thing.name
            if zones is not None:
                drawn = self._zones(Zones(zones, datetime.now(UTC)))  # anew, what is not as it was
                if drawn != list(self.maps.now()):
                    self.maps.put("zones", drawn)
                self._has_zones = True
            self._feed.take_in(look)
            self._unsaved = self._unsaved or not nothing
            return gone | set(regions)

    def follow(
        self,
        stop: threading.Event,
        heard: Heard | None = None,
        *,
        patience: float = 0.2,
        save_every: float | None = None,
    ) -> None:
        """Follow the database until told to stop, through its restarts, too.

        Parameters
        ----------
        heard : called with the ids that changed, after they are taken in
        patience : seconds between looks whether to stop, and before another try to connect
        save_every : seconds between saves at least, where something changed; never if not given
        """
        saved = -float("inf")

        def wake(payloads: tuple[str, ...] | None) -> None:
            nonlocal saved
            if payloads is None or payloads:
                changed = self.catch_up()
                if changed and heard is not None:
                    heard(changed)
            if save_every is not None and self._unsaved and time.monotonic() >= saved + save_every:
                self._save_if_there_is_a_map()
                saved = time.monotonic()

        self._feed.follow(stop, wake, patience=patience)
        if save_every is not None and self._unsaved:
            with suppress(DBAPIError):  # the server is away; the next process begins anew
                self._save_if_there_is_a_map()

    def _save_if_there_is_a_map(self) -> None:
        with suppress(LookupError):  # it was dropped, and may be imported again
            self.save()

    @property
    def _field(self) -> str:
        return f"occupied {self.regions.voxel_size} m"


def _by(connection: Connection) -> list[str]:
    """Whose states one can go on from: another release may make other voxels of the same mesh."""
    return [version("semmap"), server(connection)]
