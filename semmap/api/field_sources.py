"""The service of the fields of a map: run it, and its sources."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semmap.api.live_events import timer
from semmap.fields.service.client import ServiceAddress, ServiceConnection

if TYPE_CHECKING:
    from collections.abc import Iterator

    from semmap.api.map_questions import MapQuestions


class FieldSources:
    """The part of `SpatialFields` that needs the running service, or is it."""

    def __init__(
        self, address: ServiceAddress, open_map: Callable[[], MapQuestions], voxel_size: float
    ) -> None:
        self._address, self._open_map = address, open_map
        self.voxel_size = voxel_size

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
        with ServiceAddress(self._address.url, map.name).find() as running:
            if running is not None:
                raise ValueError(f"a service of {map.name} is running: stop it first")
        path = self._address.socket(map.name)
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
        """List the running sources: their updates, what they provide, and their errors."""
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
        percepts : socket, recording:FOLDER, mcap:FILE or plugin:NAME
        source : the installed source; by default that of `name`
        rate : the most updates per second
        timeout : seconds without a percept until what it provides is unknown; 0 for never

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
        """Stop a source of the running service; what it provides is unknown from then on."""
        with self._service() as service:
            service.ask("stop", name=name)

    @contextmanager
    def _service(self) -> Iterator[ServiceConnection]:
        with self._address.find() as found:
            if found is None:
                raise LookupError(
                    "no service is running for this map: start one by semmap fields serve"
                )
            yield found
