"""The service: a mirror of a map, the sources, and the relations of all that is on one grid.

Source: reMap, section 5, and "VDB-based Spatially Grounded Semantics", sections IV and VI.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from semmap.database.maps import see_map
from semmap.fields.maps.live_entities import LiveEntities
from semmap.fields.queries.catalogue import FieldCatalogue
from semmap.fields.queries.mirror_catalogue import mirror_catalogue
from semmap.fields.relations.event_bus import EventBus
from semmap.fields.relations.facts import RelationEvent
from semmap.fields.relations.tracker import RelationTracker
from semmap.fields.service.percept_feeds import Inbox, make_feed
from semmap.fields.service.percept_json import read_percept
from semmap.fields.service.replies import query_reply, update_map
from semmap.fields.service.settings import ServiceSettings, SourceSettings
from semmap.fields.sources.manager import SourceManager
from semmap.fields.sources.source import Source, check_percept, make_source
from semmap.fields.store.event_channel import EventPublisher, ServerError, as_json
from semmap.fields.store.map_store import load_maps
from semmap.fields.store.names import read_map_vocabulary, read_names
from semmap.fields.store.run_statement import run
from semmap.fields.store.source_history import SourceHistory
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.language.names import NameIndex
from semmap.query.change_feed import announce_fields
from semmap.query.snapshot import Snapshot

if TYPE_CHECKING:
    from sqlalchemy import Connection, Engine

KEPT = "kept"
"""The source of the fields that users stored."""

ANNOUNCED_EVERY = 0.05
"""The least seconds between two announcements that fields have changed."""

_log = logging.getLogger(__name__)


class FieldService:
    """Runs sources, follows a map on voxels of an edge in metres, and answers requests."""

    def __init__(
        self,
        engine: Engine,
        map_name: str,
        voxel_size: float = 0.05,
        settings: ServiceSettings | None = None,
    ) -> None:
        self.map_name = map_name
        self.bus = EventBus()
        self.settings = settings or ServiceSettings()
        self._engine = engine
        self._vocabulary = read_map_vocabulary()
        self.mirror = VoxelMirror.resume(engine, map_name, voxel_size)
        self.mirror.catch_up()
        self._live = LiveEntities(self.mirror)
        self.tracker = RelationTracker.of(self.mirror)
        self.tracker.update(self.mirror.regions.entities())
        self._manager = SourceManager(self.mirror.maps)
        self._inboxes: dict[str, tuple[Inbox, Source]] = {}
        self._running: dict[str, SourceSettings] = {}
        self._most = max(1, round(self.settings.keep_for / max(self.settings.keep_every, 1e-3)))
        self._history = SourceHistory(self._most)
        self._names: tuple[int, NameIndex] = (-1, NameIndex())
        self._followed = 0
        self._kept: list[Any] = []
        self._wake = threading.Event()
        self._news = threading.Event()
        self._stop = threading.Event()
        self.mirror.maps.on_put(self._wake.set)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Run the sources and follow the map while the context lasts."""
        tasks = (self._follow, self._show_sources, self._publish, self._announce, self._keep)
        threads = [threading.Thread(target=t, name=t.__name__, daemon=True) for t in tasks]
        for thread in threads:
            thread.start()
        try:
            begin = datetime.now(UTC)  # of all recordings
            for each in self.settings.sources:
                self.start_source(each, begin)
            yield
        finally:
            self._stop.set()
            self._wake.set()
            self._keep_sources()  # before the sources withdraw their maps
            self._manager.close()
            for thread in threads:
                thread.join(5)

    def _follow(self) -> None:
        def on_change(changed: set[int]) -> None:
            self._followed += 1
            self.bus.publish(self.tracker.update(changed))
            self._news.set()

        self.mirror.follow(self._stop, on_change, save_every=self.settings.save_every)

    def _show_sources(self) -> None:
        """Put what sources see on the grid, and publish the relations that begin and end."""
        while not self._stop.is_set():
            came = self._wake.wait(0.2)
            self._wake.clear()
            try:
                changed = self._live.update(self.mirror.maps.now())
                if changed:
                    self.bus.publish(self.tracker.update(changed))
                    self._live.forget(changed)
                if came:
                    self._news.set()
            except ValueError:  # a region beyond the limits
                _log.exception("the maps of the sources cannot be shown on the grid")

    def _publish(self) -> None:
        """Send events on the channel of the database, in a thread of its own: it may be slow."""
        publisher = EventPublisher(self._engine)
        with self.bus.stream() as stream:
            while not self._stop.is_set():
                event = stream.get(0.2)
                with suppress(ServerError):  # the next call sends what waits
                    publisher.publish([event] if event else [])

    def _announce(self) -> None:
        """Tell the followers of the map that fields have changed, some times a second at most."""
        while not self._stop.wait(ANNOUNCED_EVERY):
            if self._news.wait(0.2):
                self._news.clear()
                try:
                    announce_fields(self._engine, self.map_name)
                except ServerError:
                    self._news.set()  # while the server is away

    def _keep(self) -> None:
        while not self._stop.wait(self.settings.keep_every):
            self._keep_sources()

    def _keep_sources(self) -> None:
        updates = {
            source: update
            for source, update in self.mirror.maps.newest().items()
            if source in self._running
        }
        try:
            with self._transaction() as connection:
                self._history.save(connection, updates)
        except ServerError:
            self._history = SourceHistory(self._most)  # all of it is tried again
        except (LookupError, ValueError):
            _log.exception("the maps of the sources cannot be kept")

    @contextmanager
    def _transaction(self) -> Iterator[Connection]:
        with self._engine.begin() as connection:
            see_map(connection, self.map_name)
            yield connection

    @contextmanager
    def _snapshot(self) -> Iterator[Snapshot]:
        with self._transaction() as connection:
            yield Snapshot.of(connection, self.map_name)

    def start_source(self, given: SourceSettings, begin: datetime | None = None) -> None:
        """Start a source, whose recording begins at `begin`, aware, by default now.

        Raises LookupError, ValueError or TypeError: there is no such source or percept plug-in, a
        source of that name is running, or an option is wrong.
        """
        feed = make_feed(given.percepts, given.name, begin, source=given.source)
        voxel = {"voxel_size": self.mirror.regions.voxel_size}
        try:
            source = make_source(given.source, self._vocabulary, voxel, **given.options)
        except TypeError as error:
            raise ValueError(f"the options of {given.name} are wrong: {error}") from None
        self._manager.activate(
            given.name, source, feed, rate=given.rate, timeout=given.timeout or None
        )
        self._running[given.name] = given
        if isinstance(feed, Inbox):
            self._inboxes[given.name] = feed, source

    def stop_source(self, name: str) -> None:
        """Stop a source, whose properties are then unknown; LookupError if it is not running."""
        self._manager.deactivate(name)
        self._keep_sources()
        self._running.pop(name, None)
        self._inboxes.pop(name, None)

    def list_sources(self) -> list[dict[str, Any]]:
        """Return a row for each running source."""
        newest = self.mirror.maps.newest()
        rows = []
        for name, status in self._manager.status().items():
            update = newest.get(name)
            rows.append(
                {
                    "name": name,
                    "source": self._running[name].source,
                    "percepts": self._running[name].percepts,
                    "rate": status.rate,
                    "updates": status.updates,
                    "seconds": round(status.seconds, 4),
                    "provides": sorted(update.provides) if update else [],
                    "time": update.time.isoformat() if update else None,
                    "error": status.error or (None if status.updates else "no percept yet"),
                }
            )
        return rows

    def put_percept(self, name: str, percept: Any) -> None:
        """Give a source a percept, as JSON.

        Raises LookupError or ValueError: no such source takes percepts from the socket, or it is
        wrong.
        """
        if name not in self._inboxes:
            there = ", ".join(sorted(self._inboxes)) or "none"
            raise LookupError(f"no source {name} takes percepts from the socket; sources: {there}")
        inbox, source = self._inboxes[name]
        read = read_percept(percept)
        check_percept(name, source, read)
        inbox.put(read)

    def answer(self, request: dict[str, Any]) -> Iterator[Any]:
        """Yield the replies to a request."""
        given = {key: value for key, value in request.items() if key != "do"}
        match request.get("do"):
            case "hello":
                yield self._hello(given.get("map"))
            case "query":
                yield query_reply(self.catalogue(), given.pop("text"), self._transaction, **given)
            case "update":
                with self._transaction() as connection:
                    driver = connection.connection.driver_connection
                    yield update_map(self.mirror, self.catalogue(), given["text"], driver)
            case "at":
                yield self.mirror.at(given["point"])
            case "ls":
                yield self.mirror.sizes()
            case "sources":
                yield self.list_sources()
            case "start":
                self.start_source(SourceSettings(**given))
                yield {}
            case "stop":
                self.stop_source(str(given["name"]))
                yield {}
            case "percept":
                self.put_percept(str(given["name"]), given["percept"])
                yield {}
            case "watch":
                yield from self._watch(**given)
            case other:
                raise ValueError(f"there is no request {other!r}")

    def catalogue(self) -> FieldCatalogue:
        """Return what queries read."""
        with self._snapshot() as seen:
            followed, names = self._names
            if followed != self._followed:
                followed = self._followed  # what changes while they are read is read again
                names = read_names(seen)
                self._names = followed, names
            kept = run(
                seen.session,
                "SELECT f.name, f.version FROM field f JOIN field_version v ON v.field_id = f.id "
                "AND v.version = f.version WHERE f.map_id = current_map() AND v.state IS NULL",
            )
            if kept != self._kept:
                self._kept = kept
                self.mirror.maps.put(KEPT, load_maps(seen, self._vocabulary).values())
        return mirror_catalogue(
            self.mirror,
            names,
            self._vocabulary,
            tracker=lambda: self.tracker,
            open_snapshot=self._snapshot,
        )

    def _hello(self, wanted: str | None) -> dict[str, Any]:
        return {
            "map": self.map_name,
            "voxel_size": self.mirror.regions.voxel_size,
            "is_meant": self._is_meant(wanted),
        }

    def _is_meant(self, wanted: str | None) -> bool:
        """Return whether a command with this option `--map` uses the map of the service."""
        if wanted is not None:
            return wanted == self.map_name
        with self._engine.connect() as connection:  # the choice of `semmap use` may have changed
            chosen = run(connection, "SELECT current_setting('semmap.map', true) AS name")[0].name
            maps = [row.name for row in run(connection, "SELECT name FROM map")]
        return bool(chosen == self.map_name if chosen else maps == [self.map_name])

    def _watch(self, seconds: float | None = None) -> Iterator[dict[str, Any]]:
        """Yield what is true now, and then what begins and ends."""
        with self.bus.stream() as stream:
            for fact, since in self.tracker.holding().items():
                yield {"held": True} | as_json(RelationEvent(*fact, began=True, time=since))
            yield {"held": False}
            end = None if seconds is None else datetime.now(UTC).timestamp() + seconds
            while not self._stop.is_set():
                if end is not None and datetime.now(UTC).timestamp() >= end:
                    break
                event_or_none = stream.get(0.2 if end is None else min(0.2, seconds or 0.2))
                if event_or_none is not None:
                    yield as_json(event_or_none)
        yield {"over": True}
