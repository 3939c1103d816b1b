"""What space contains: the fields of a map, asked of the running service or of the kept state."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from semmap.api.checked import checked_class
from semmap.api.live_events import timer
from semmap.fields.service.client import ServiceConnection, find_service, socket_of
from semmap.html_table import html_table

if TYPE_CHECKING:
    from semmap.api.kept_fields import Note
    from semmap.api.live_events import LiveEvents
    from semmap.api.map_questions import MapQuestions

VOXEL_SIZE = 0.05
"""Metres."""


class EntityVoxels(NamedTuple):
    """An entity, its kind, the number of its voxels and their volume in cubic metres."""

    name: str
    kind: str
    voxels: int
    volume: float


class KeptField(NamedTuple):
    """A stored field: its property, the entity it is about, its voxels and its versions."""

    name: str
    property: str
    about: str | None
    voxels: int
    versions: int


class FieldChanges(NamedTuple):
    """The changes of an update: the names of new regions by blank node, and all changed names."""

    new: dict[str, str]
    changed: list[str]


@dataclass(frozen=True)
class SpaceAnswer(Sequence[tuple[Any, ...]]):
    """The answer of a query on fields: a sequence of rows; it is true if an ASK is.

    Attributes
    ----------
    names : the variables of a SELECT
    rows : names of entities, numbers, texts, and voxels as (x, y, z), metres in the map's frame
    total : the number of rows without the limit
    truth : the answer of an ASK
    stored : of STORE, a mapping with `property` and `voxels`, and `file`, `kept` and `version`
    left_out : the entities without voxels, of which the answer says nothing
    notes : who answered, and from what
    """

    names: tuple[str, ...] = ()
    rows: tuple[tuple[Any, ...], ...] = ()
    total: int = 0
    truth: bool | None = None
    stored: dict[str, Any] | None = None
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        """Whether an ASK is true; else, whether there are rows, or a map."""
        return bool(self.rows or self.stored) if self.truth is None else self.truth

    def __len__(self) -> int:
        """The number of rows."""
        return len(self.rows)

    def __getitem__(self, index: Any) -> Any:
        """A row, or a tuple of rows for a slice."""
        return self.rows[index]

    def _repr_html_(self) -> str:
        if self.truth is not None:
            return f"<p>{'yes' if self.truth else 'no'}</p>"
        if self.stored is not None:
            return html_table(list(self.stored), [tuple(self.stored.values())])
        return html_table(self.names, self.rows)


@checked_class
class SpatialFields:
    """The fields of a map: occupied and free space, rooms, views, stored fields; docs/fields.md.

    The running service of the map answers, if there is one with voxels of this size (metres), else
    what the map and sources kept. `note` gets what a user should know: who answered, and what has
    no voxels. `open_map` is called when the service cannot answer.
    """

    def __init__(
        self,
        url: str | None,
        map_name: str | None,
        open_map: Callable[[], MapQuestions],
        voxel_size: float = VOXEL_SIZE,
        note: Note = lambda text: None,
    ) -> None:
        self._url, self._map_name, self._open_map, self._note = url, map_name, open_map, note
        self.voxel_size = voxel_size

    def with_voxel_size(self, voxel_size: float) -> SpatialFields:
        """The same with voxels of another size, metres."""
        return SpatialFields(self._url, self._map_name, self._open_map, voxel_size, self._note)

    def at(self, x: float, y: float, z: float) -> list[tuple[str, str]]:
        """Return name and kind of the entities that have the voxel at a point, metres."""
        import math

        point = [float(x), float(y), float(z)]
        if not all(map(math.isfinite, point)):
            raise ValueError(f"({x}, {y}, {z}) is not a point: give three finite numbers")
        with self._find(self.voxel_size) as service:
            if service is not None:
                rows = service.ask("at", point=point)
            else:
                rows = self._kept_space().at(point)
        return [(name, kind) for name, kind in rows]

    def ls(self) -> list[EntityVoxels]:
        """List the entities that have voxels."""
        with self._find(self.voxel_size) as service:
            found = service.ask("ls") if service is not None else self._kept_space().sizes()
        cube = self.voxel_size**3
        return [EntityVoxels(name, kind, n, round(n * cube, 6)) for name, kind, n in found]

    def query(
        self,
        text: str,
        *,
        limit: int | None = None,
        output: str | Path | None = None,
        keep: str | None = None,
    ) -> SpaceAnswer:
        """Answer a query of docs/fields_language.md.

        Parameters
        ----------
        text : SPARQL, see docs/fields_language.md
        limit : the most rows
        output : file for the map of STORE (.vdb)
        keep : name under which the map of STORE is stored in the database

        Raises
        ------
        ValueError
            The text is wrong, or nothing states a property, such as where people look without a
            source of gazes.
        """
        from semmap.api.kept_fields import query_kept

        file = None if output is None else Path(output).absolute()
        if limit is not None and limit < 0:
            raise ValueError(f"limit is {limit}: give a number of at least 0")
        if file is not None and not file.parent.is_dir():
            raise ValueError(f"{output}: there is no folder {file.parent}: make it first")
        given = {
            "limit": limit,
            "output": None if file is None else str(file),
            "keep": keep,
        }
        notes: list[str] = []

        def note(text: str) -> None:
            notes.append(text)
            self._note(text)

        with self._find(self.voxel_size) as service:
            if service is not None:
                note(f"answered by the service of {service.map_name}")
                reply = service.ask("query", text=text, **given)
            else:
                reply = query_kept(self._open_map(), self.voxel_size, note, text, **given)
        if reply["left_out"]:
            left_out = reply["left_out"]
            more = ", ..." if len(left_out) > 5 else ""
            names = ", ".join(left_out[:5])
            note(f"unknown, as they have no voxels: {len(left_out)} entities: {names}{more}")
        rows = ((*map(_plain, row),) for row in reply.get("rows", ()))
        return SpaceAnswer(
            tuple(reply.get("variables", ())),
            tuple(rows),
            reply.get("total", 0),
            reply.get("ask"),
            reply.get("store"),
            tuple(reply["left_out"]),
            tuple(notes),
        )

    def update(self, text: str) -> FieldChanges:
        """Insert and delete regions of entities; the map keeps them.

        Parameters
        ----------
        text : INSERT or DELETE; a blank node, or a name that is not in the map, becomes a region

        Raises
        ------
        ValueError
            The text is wrong, or changes the field of a source; nothing was changed.
        """
        from semmap.api.kept_fields import update_kept

        with self._find(self.voxel_size) as service:
            if service is not None:
                reply = service.ask("update", text=text)
            else:
                reply = update_kept(self._open_map(), self.voxel_size, self._note, text)
        return FieldChanges(**reply)

    # --- stored fields

    def kept(self) -> list[KeptField]:
        """List the stored fields."""
        from semmap.fields.store import field_store
        from semmap.fields.store.map_store import load_maps
        from semmap.fields.store.names import read_map_vocabulary

        with self._open_map().snapshot() as seen:
            return [
                KeptField(
                    name, m.property.name, m.about, len(m), len(field_store.versions(seen, name))
                )
                for name, m in load_maps(seen, read_map_vocabulary()).items()
            ]

    def __iter__(self) -> Iterator[KeptField]:
        """Iterate over the stored fields."""
        return iter(self.kept())

    def forget(self, name: str) -> None:
        """Delete a stored field with all its versions; LookupError if there is none."""
        from semmap.fields.store import field_store

        opened = self._open_map()
        with opened.transaction(), opened.snapshot() as seen:
            known = field_store.names(seen)
            if name not in known:
                raise LookupError(
                    f"there is no field {name} in this map; fields: {', '.join(known) or 'none'}"
                )
            field_store.forget(seen.session, name)

    def export(
        self, folder: str | Path, kept: str | None = None, version: int | None = None
    ) -> dict[str, Any]:
        """Write the voxels of all entities, or a stored field: OpenVDB, JSON and points.

        Returns a summary: `folder`, `voxel_size`, `voxels` and further counts.

        Parameters
        ----------
        folder : gets sets.vdb, sets.json and points.ply, or field.vdb, points.ply and legend.json
        kept : the stored field to export; by default all entities
        version : of the stored field; by default the newest

        Raises
        ------
        LookupError
            There is no such field or version.
        """
        from semmap.api.kept_fields import current_mirror, export_entities, export_field

        if kept is not None:
            return export_field(self._open_map(), kept, version, Path(folder))
        if version is not None:
            raise ValueError("version= is one of a stored field: name the field by kept=")
        mirror = current_mirror(self._open_map(), self.voxel_size, self._note)
        return export_entities(mirror, Path(folder))

    def watch(
        self,
        callback: Callable[[dict[str, Any]], Any] | None = None,
        *,
        seconds: float | None = None,
        save_every: float | None = None,
    ) -> LiveEvents[dict[str, Any]]:
        """Follow the map: the relations between entities that begin and end.

        Without a service, they are published on the channel `semmap_events` of the database, too.

        Returns events as mappings: `event` ("begin" or "end"), `subject`, `relation`, `object` and
        `time`. Its `count` is the number of relations that are true already.

        Parameters
        ----------
        callback : gets each event, in a thread of its own; without it, loop over the result
        seconds : stop after this time; by default when the result is closed
        save_every : seconds between saves of the voxels, from which later calls start; the service
            has its own
        """
        from semmap.api.live_events import watch_map, watch_service

        found = watch_service(self._find(self.voxel_size), seconds, callback, self._note)
        if found is not None:
            return found
        self._note("no service is running: relations of the map alone, without sources")
        return watch_map(
            self._open_map(), self.voxel_size, self._note, seconds, save_every, callback
        )

    # --- the running service

    def serve(
        self,
        config: str | Path | None = None,
        *,
        sources: Sequence[str] = (),
        rates: Sequence[str] = (),
        seconds: float | None = None,
        stop: threading.Event | None = None,
        started: Callable[[str, Path, list[str]], Any] = lambda name, path, sources: None,
    ) -> None:
        """Follow the map, run sources, and answer questions on a local socket, while this runs.

        The methods of fields, of any process of this user, then ask this service.

        Parameters
        ----------
        config : YAML with the settings of docs/fields.md
        sources : NAME=PERCEPTS or NAME:SOURCE=PERCEPTS; PERCEPTS are socket, recording:FOLDER,
            mcap:FILE or plugin:NAME
        rates : NAME=UPDATES PER SECOND
        seconds : end after this time; by default when `stop` is set
        started : called with the names of the map, the socket and the sources when it answers

        Raises
        ------
        ValueError
            A setting is wrong, or a service of the map is running.
        """
        from semmap.fields.service.server import serving
        from semmap.fields.service.service import FieldService
        from semmap.fields.service.settings import read_settings

        settings = read_settings(None if config is None else Path(config), sources, rates)
        map = self._open_map()
        with find_service(self._url, map.name) as running:
            if running is not None:
                raise ValueError(f"a service of {map.name} is running: stop it first")
        path = socket_of(self._url, map.name)
        stop = stop or threading.Event()
        service = FieldService(map.engine, map.name, self.voxel_size, settings)
        ending = timer(seconds, stop.set)
        try:
            with service.running(), serving(path, service.answer):
                started(map.name, path, [each.name for each in settings.sources])
                stop.wait()
        finally:
            ending.cancel()

    def send(self, name: str, percepts: Mapping[str, Any] | Iterable[Any]) -> None:
        """Give a source of the running service a percept, or several, one after the other.

        Parameters
        ----------
        name : of the source
        percepts : with the keys of docs/fields.md, such as ``{"poses": {"human1": {"from": [6.5,
            -1, 1.6], "to": [7.1, 1, 0.8]}}}``

        Raises
        ------
        LookupError
            No service is running.
        ValueError
            No such source takes percepts from the socket, or a percept is wrong.
        """
        with self._service() as service:
            for percept in [percepts] if isinstance(percepts, Mapping) else percepts:
                service.ask("percept", name=name, percept=percept)

    def sources(self) -> list[dict[str, Any]]:
        """List the running sources: their updates, their properties, and their errors."""
        with self._service() as service:
            return list(service.ask("sources"))

    def start_source(
        self,
        name: str,
        percepts: str = "socket",
        *,
        source: str | None = None,
        rate: float = 20.0,
        timeout: float = 30.0,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Start a source in the running service.

        Parameters
        ----------
        name : of the source
        percepts : socket, recording:FOLDER, mcap:FILE or plugin:NAME
        source : the installed source; by default that of `name`
        rate : the most updates per second
        timeout : seconds without a percept until its properties are unknown; 0 for never
        options : of the source

        Raises
        ------
        LookupError
            No service is running.
        ValueError
            There is no such source, one of that name is running, or an option is wrong.
        """
        kept, _, path = percepts.partition(":")
        if kept in ("recording", "mcap"):
            percepts = f"{kept}:{Path(path).absolute()}"
        with self._service() as service:
            service.ask(
                "start",
                name=name,
                source=source or name,
                percepts=percepts,
                rate=rate,
                timeout=timeout,
                options=dict(options or {}),
            )

    def stop_source(self, name: str) -> None:
        """Stop a source of the running service; its properties are unknown from then on."""
        with self._service() as service:
            service.ask("stop", name=name)

    def _find(self, size: float | None = None) -> AbstractContextManager[ServiceConnection | None]:
        return find_service(self._url, self._map_name, size)

    @contextmanager
    def _service(self) -> Iterator[ServiceConnection]:
        with self._find() as found:
            if found is None:
                raise LookupError(
                    "no service is running for this map: start one by semmap fields serve"
                )
            yield found

    def _kept_space(self) -> Any:
        from semmap.api.kept_fields import kept_space

        return kept_space(self._open_map(), self.voxel_size, self._note)


def _plain(value: Any) -> Any:
    """A value of a reply; a voxel of the service is a list."""
    return tuple(value) if isinstance(value, list) else value
