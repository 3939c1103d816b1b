"""A region map that follows the map in the database, through restarts of either.

Entities that were imported, moved or deleted are voxelised anew, and only they. A NOTIFY wakes the
mirror; what changed it reads from the history by a cursor, so that a message missed is not lost.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from datetime import UTC, datetime

import psycopg
from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import DBAPIError

from semmap.fields.maps import Maps
from semmap.fields.region_map import RegionMap
from semmap.fields.source import (
    changed_since,
    cursor,
    read_occupants,
    read_vocabulary_of_map,
    read_zones,
)
from semmap.fields.sources import Zones, ZoneSource

__all__ = ["Mirror"]

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
        self.maps = Maps()
        self._zones = ZoneSource(read_vocabulary_of_map(), voxel_size=voxel_size)
        self._engine = engine
        self._map_name = map_name
        self._since: str | None = None

    def catch_up(self) -> set[int]:
        """Take in what changed since the last time, all the first time; the ids that did.

        A look that fails changes nothing: the next one sees the same changes again.
        """
        options = {"isolation_level": "REPEATABLE READ"}  # the cursor is that of what is read
        with self._engine.connect().execution_options(**options) as connection:
            self._choose(connection)
            now = cursor(connection)
            changed = None if self._since is None else changed_since(connection, self._since)
            if changed is not None and not changed:
                self._since = now
                return set()
            things = read_occupants(connection, changed)
            zones = tuple(read_zones(connection))
        regions = {thing.id: thing.regions(self.regions.voxel_size) for thing in things}
        gone = set(self.names) - set(regions) if changed is None else changed - set(regions)
        for number in (gone | set(regions)) & set(self.names):
            self.regions.remove(number)
            del self.names[number]
        self.names |= {thing.id: thing.name for thing in things}
        self.regions.insert_many(
            [(number, region) for number, each in regions.items() for region in each]
        )
        drawn = self._zones(Zones(zones, datetime.now(UTC)))  # anew, what is not as it was
        if drawn != list(self.maps.now()):
            self.maps.put("zones", drawn)
        self._since = now
        return gone | set(regions)

    def follow(
        self, stop: threading.Event, heard: Heard | None = None, *, patience: float = 0.2
    ) -> None:
        """Follow the database until told to stop, through its restarts, too.

        Parameters
        ----------
        heard : called with the ids that changed, after they are taken in
        patience : seconds between looks whether to stop, and before another try to connect
        """
        while not stop.is_set():
            try:
                with self._engine.connect() as connection:
                    driver = connection.connection.driver_connection
                    assert isinstance(driver, psycopg.Connection)
                    driver.autocommit = True
                    driver.execute("LISTEN semmap")
                    self._tell(heard)
                    while not stop.is_set():
                        if any(True for _ in driver.notifies(timeout=patience, stop_after=1)):
                            self._tell(heard)
                    driver.execute("UNLISTEN semmap")
                    driver.autocommit = False
            except (psycopg.OperationalError, DBAPIError):
                stop.wait(patience)  # the server is away; the cursor knows where we were

    def _tell(self, heard: Heard | None) -> None:
        changed = self.catch_up()
        if changed and heard is not None:
            heard(changed)

    def _choose(self, connection: Connection) -> None:
        if self._map_name is None:
            self._map_name = connection.execute(
                text("SELECT name FROM map WHERE id = current_map()")
            ).scalar()
            if self._map_name is None:
                raise LookupError("there is no map: semmap import FILE makes one")
        connection.execute(
            text("SELECT set_config('semmap.map', :name, true)"), {"name": self._map_name}
        )
