"""Reads the graph that people drew on the current map: Nav2 edges, and lanes of Open-RMF."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from sqlalchemy import text

from planner.drawn_graph import DrawnEdge, DrawnGraph, DrawnNode
from planner.topology import Topology
from semmap.finite_number import is_finite_number
from semmap.query.snapshot import Snapshot

_EDGES = """
SELECT a.name AS start, b.name AS "end", l.relation, l.properties FROM link l
JOIN entity a ON a.id = l.from_id JOIN entity b ON b.id = l.to_id
WHERE a.map_id = current_map() AND l.relation IN ('lane', 'nav2_edge') ORDER BY a.name, b.name
"""


def read_drawn_graph(seen: Snapshot, topology: Topology) -> DrawnGraph:
    """The drawn graph of the current map; its nodes are the point regions of a topology.

    Raises LookupError if the map has no drawn edges.
    """
    rows = seen.connection.execute(text(_EDGES)).all()
    if not rows:
        raise LookupError(
            "the map has no drawn graph: import a Nav2 route graph (GeoJSON) or an Open-RMF "
            "building with lanes, or plan without drawn=True"
        )
    names = {name for row in rows for name in (row.start, row.end)}
    nodes = {}
    for region in topology.regions:
        if region.name in names:
            place, point = topology.places[region.places[0]], region.outline.centroid
            nodes[region.name] = DrawnNode(region.name, place.name, point.x, point.y, place.floor)
    edges = [edge for row in rows for edge in _edges(row)]
    return DrawnGraph(nodes, edges)


def _edges(row: Any) -> Iterator[DrawnEdge]:
    """The edges of a link: lanes are drawn once for both directions, parallel edges share one."""
    if row.relation == "lane":
        limit = _positive(row.properties.get("speed_limit"))
        yield DrawnEdge(row.start, row.end, speed_limit=limit)
        if row.properties.get("bidirectional", True):
            yield DrawnEdge(row.end, row.start, speed_limit=limit)
        return
    for given in (row.properties, *row.properties.get("also", ())):
        about: Mapping[str, Any] = given.get("metadata") or {}
        is_ride = about.get("kind") == "ride"
        yield DrawnEdge(
            row.start,
            row.end,
            _positive(about.get("abs_time_taken")),
            _positive(about.get("abs_speed_limit")),
            about.get("connector"),
            about.get("elevator") if is_ride else None,
        )


def _positive(value: Any) -> float | None:
    return float(value) if is_finite_number(value) and value > 0 else None
