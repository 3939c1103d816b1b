"""From rules to penalties on the edges of a routing graph."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import datetime

from planner.cost_rules import CostRule
from planner.graph_edges import Penalties
from planner.routing_graph import RoutingGraph
from planner.storey_costmaps import StoreyCostmaps
from planner.topology import PlaceRegion


def penalties(
    graph: RoutingGraph,
    rules: Sequence[CostRule],
    at: datetime | None = None,
    *,
    costmaps: StoreyCostmaps | None = None,
) -> Penalties:
    """The penalties that rules put on the edges of a graph at a moment.

    Travel leads around a forbidden region and takes as long as that. A region that costs seconds
    adds them to travel through it, or the additional time of the detour if that is less. Without
    costmaps, the places of the region are meant. Without a moment, rules that have hours do not
    apply.
    """
    found = Penalties()
    if costmaps is not None:
        _add_detours(graph, costmaps, forbidden_regions(graph, rules, at), found)
    for rule in (r for r in rules if r.applies_at(at)):
        for place in graph.topology.places.values():
            if rule.selects("place", (place.name, place.label), place.types, place.properties):
                edges = graph.edges_into(place.name)
                found.add(edges, rule.seconds, f"{place.name} is to be avoided")
        for i, c in enumerate(graph.connectors):
            if rule.selects("connector", (c.name,), (c.type,), c.properties):
                found.add((2 * i, 2 * i + 1), rule.seconds, f"{c.name} is to be avoided")
        for region in graph.topology.regions:
            if _selects_region(rule, region):
                _add_region(graph, costmaps, region, rule.seconds, found)
    return found


def forbidden_regions(
    graph: RoutingGraph, rules: Sequence[CostRule], at: datetime | None = None
) -> list[PlaceRegion]:
    """The regions that rules forbid at a moment."""
    forbidding = [r for r in rules if math.isinf(r.seconds) and r.applies_at(at)]
    return [
        region
        for region in graph.topology.regions
        if any(_selects_region(rule, region) for rule in forbidding)
    ]


def _selects_region(rule: CostRule, region: PlaceRegion) -> bool:
    return rule.selects("region", (region.name, region.label), region.types, region.properties)


def _add_detours(
    graph: RoutingGraph,
    costmaps: StoreyCostmaps,
    regions: Sequence[PlaceRegion],
    found: Penalties,
) -> None:
    """Let travel lead around all forbidden regions of its place; block it where none can."""
    for place in dict.fromkeys(p for r in regions for p in r.places):
        here = [r for r in regions if place in r.places]
        names = " and ".join(r.name for r in here)
        reason = f"{names} is to be avoided, and the path in {place} leads through it"
        for edge, seconds, metres in _longer_travel(graph, costmaps, place, here):
            if math.isinf(seconds):
                found.blocked.setdefault(edge, reason)
            else:
                found.detours[edge] = seconds, metres


def _add_region(
    graph: RoutingGraph,
    costmaps: StoreyCostmaps | None,
    region: PlaceRegion,
    seconds: float,
    found: Penalties,
) -> None:
    """Let travel through a region, or around it, cost more."""
    reason = f"{region.name} is to be avoided"
    for place in region.places:
        if costmaps is None:
            found.add(graph.edges_into(place), seconds, reason)
        elif math.isfinite(seconds):
            for edge, longer, _ in _longer_travel(graph, costmaps, place, [region]):
                found.add([edge], min(longer - float(graph.base[edge]), seconds), reason)


def _longer_travel(
    graph: RoutingGraph, costmaps: StoreyCostmaps, place: str, regions: Sequence[PlaceRegion]
) -> Iterator[tuple[int, float, float]]:
    """The travel edges of a place that are longer around regions: edge, seconds, metres."""
    edges = graph.travel_edges.get(place, slice(0, 0))
    storey = costmaps.storey_of(place)
    with costmaps.also_avoiding({storey: regions}):
        travel = graph.travel_in(place)
    for k, edge in enumerate(range(edges.start, edges.stop)):
        if travel.seconds[k] > graph.base[edge]:
            yield edge, float(travel.seconds[k]), float(travel.metres[k])
