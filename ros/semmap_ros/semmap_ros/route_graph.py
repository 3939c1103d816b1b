"""The route graph of a map as a file for Nav2, whose route server is asked to load it again."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType

from planner.exchange.nav2_route import dumps, nav2_graph
from planner.exchange.reader import read_building_outline
from planner.exchange.route_graph import ExchangeError
from semmap_ros.optional import SetRouteGraph

if TYPE_CHECKING:
    import semmap
    from semmap_ros.node import MapNode

AGAIN = 5.0
"""After how many seconds without an answer the route server is asked again."""


def read_route_graph(node: MapNode, map: semmap.Map) -> str | ExchangeError:
    """Return the graph as GeoJSON, or why there is none; "" without the parameter `route_graph`."""
    if not node.value("route_graph"):
        return ""
    try:
        with map.snapshot() as seen:
            building = read_building_outline(seen)
        graph = map.routing_graph(node.value("robot") or None)
        return dumps(nav2_graph(graph, building=building, name=map.name))
    except ExchangeError as error:
        return error


class RouteGraphFile:
    """Keeps the file of the parameter `route_graph` as the map is; use it in one thread."""

    def __init__(self, node: MapNode) -> None:
        self._node = node
        self._last = ""
        self._unanswered: Path | None = None
        self._asked: Any = None
        self._asked_at = 0.0
        self._server: Any = None
        if SetRouteGraph is not None:
            self._server = node.create_client(SetRouteGraph, "route_server/set_route_graph")
            # It may not have been found yet, or miss a request while it is being found.
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            node.create_timer(AGAIN / 5, self._ask_again, clock=steady)

    def write(self, graph: str | ExchangeError) -> None:
        """Write a graph that differs from the last one; where there is none, remove the file."""
        if str(graph) != self._last:
            self._last = str(graph)
            self._node.attempt("route_graph", lambda: self._write(graph))

    def _write(self, graph: str | ExchangeError) -> None:
        file = Path(self._node.value("route_graph")).absolute()
        made = file.with_name(f".{file.name}")
        try:
            if isinstance(graph, ExchangeError):
                self._unanswered = None
                file.unlink(missing_ok=True)
                raise graph
            made.write_text(graph, encoding="utf-8")
            made.replace(file)
        except OSError as error:
            self._last = ""  # tried again after the next change
            raise ValueError(f"{file} cannot be written: {error}") from error
        self._unanswered = file
        self._ask()

    def _ask(self) -> None:
        file = self._unanswered
        if file is not None and self._server is not None and self._server.service_is_ready():
            self._asked_at = time.monotonic()
            request = SetRouteGraph.Request(graph_filepath=str(file))
            self._asked = self._server.call_async(request)
            self._asked.add_done_callback(self._answered)

    def _ask_again(self) -> None:
        if self._unanswered is not None and time.monotonic() > self._asked_at + AGAIN:
            if self._asked is not None:
                self._server.remove_pending_request(self._asked)
            self._ask()

    def _answered(self, answer: Any) -> None:
        if answer is self._asked:
            self._unanswered = None

        def check() -> None:
            if not answer.result().success:
                raise ValueError("Nav2's route server refuses the file: its log says why")

        self._node.attempt("route_graph", check)
