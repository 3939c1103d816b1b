"""Travel times between connectors by id, as they are stored, and as edges of a routing graph."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.routing_graph import RoutingGraph
from planner.topology import Topology
from planner.travel_edges import TravelEdges


class MeasuredTravel(NamedTuple):
    """The travel in a place between the approach poses of two connectors, either way.

    The place and the connectors are ids, a < b; seconds and metres are infinite if no path leads
    there.
    """

    place: int
    a: int
    b: int
    seconds: float
    metres: float


def travel_in_places(graph: RoutingGraph, places: Iterable[str]) -> Iterator[MeasuredTravel]:
    """The travel that a graph has in places; places and connectors without an id are left out."""
    for place in places:
        number = graph.topology.places[place].id
        edges = graph.travel_edges.get(place, slice(0, 0))
        for edge in range(edges.start, edges.stop) if number is not None else ():
            a, b = (graph.connectors[n[edge] // 2].id for n in (graph.tails, graph.heads))
            if number is not None and a is not None and b is not None and a < b:
                seconds, metres = float(graph.base[edge]), float(graph.metres[edge])
                yield MeasuredTravel(number, a, b, seconds, metres)


def as_travel_edges(topology: Topology, travel: NDArray[Any]) -> TravelEdges:
    """Edges, in both directions, from an array (n,) with the fields of `MeasuredTravel`.

    Unknown connectors are left out.
    """
    connectors = [*topology.connectors.values()]
    places = {p.name: p.id for p in topology.places.values()}
    ids = np.array([c.id for c in connectors], np.int64)
    first = np.array([places.get(c.places[0]) or -1 for c in connectors], np.int64)
    if not len(ids):
        travel = travel[:0]
    order = np.argsort(ids)
    ends = np.stack([travel["a"], travel["b"]])
    numbers = order[np.searchsorted(ids, ends, sorter=order).clip(max=len(ids) - 1)]
    known = (ids[numbers] == ends).all(axis=0)
    numbers, travel = numbers[:, known], travel[known]
    nodes = 2 * numbers + (first[numbers] != travel["place"])
    seconds, metres = np.tile(travel["seconds"], 2), np.tile(travel["metres"], 2)
    return TravelEdges(nodes.reshape(-1), nodes[::-1].reshape(-1), seconds, metres)
