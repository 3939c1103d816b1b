"""Why no route leads somewhere: what bars the way that the fewest things bar."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from planner.graph import Graph
from planner.topology import OUTSIDE

if TYPE_CHECKING:
    from planner.network import Network, Site

__all__ = ["why_not"]

_FORBIDDEN = 1e9
"""Seconds that a forbidden passage counts here."""


def why_not(network: Network, start: Site, goal: Site) -> str:
    """Which forbidden passages the way with the fewest of them would need, in words."""
    robot = network.robot
    said = f"no route from {start.place} to {goal.place}"
    if start.place == goal.place and start.pose is not None and goal.pose is not None:
        a, b = (f"({p.x:.2f}, {p.y:.2f})" for p in (start.pose, goal.pose))
        return f"{said}: {robot.name} finds no way in {start.place} from {a} to {b}"
    for place in (start.place, goal.place):
        if not len(network.nodes.get(place, ())):
            return f"{said}: {place} has no door; add a connector that joins it"
    for site in (start, goal):
        if np.isinf(site.seconds).all():
            return f"{said}: {_enclosed(network, site)}"
    bars = _bars(network)
    weights = network.base.copy()
    for edge, (_, dearer) in bars.items():
        weights[edge] = dearer if math.isinf(weights[edge]) else weights[edge] + dearer
    tails, heads = network.ways
    graph = Graph(tails, heads, weights, 2 * len(network.stands))
    found = graph.shortest(*network.ends(start, goal))
    if found is None:
        lift = "" if robot.rides else " without riding an elevator (behaviour use_elevator)"
        return f"{said}: nothing joins them{lift}; add the connector that is missing"
    reasons = dict.fromkeys(bars[int(e)][0] for e in found[1] if int(e) in bars)
    return f"{said}: {'; '.join(reasons)}"


def _bars(network: Network) -> dict[int, tuple[str, float]]:
    """What forbids edges, in words, and for how many seconds more they are taken nevertheless."""
    found: dict[int, tuple[str, float]] = {}
    for node in range(2 * len(network.connectors)):
        why = network.robot.obstacle(network.connectors[node // 2], node % 2)
        if why is not None:
            found[node] = why, _FORBIDDEN
    for place, edges in network.walk_edges.items():
        for edge in range(edges.start, edges.stop):
            if math.isfinite(network.seconds[edge]):
                continue
            a, b = (
                network.connectors[nodes[edge] // 2].name
                for nodes in (network.tails, network.heads)
            )
            if place == OUTSIDE:
                found[edge] = f"{a} leads outside, of which the map knows nothing", 100 * _FORBIDDEN
            else:
                why = f"{network.robot.name} finds no way in {place} from {a} to {b}"
                found[edge] = why, 10 * _FORBIDDEN
    for edge, why in network.barred_for_now.items():
        before, dearer = found.get(edge, (why, 0.0))
        found[edge] = before, dearer + _FORBIDDEN
    return found


def _enclosed(network: Network, site: Site) -> str:
    assert site.pose is not None
    x, y = site.pose.x, site.pose.y
    return f"from ({x:.2f}, {y:.2f}) in {site.place} {network.robot.name} reaches none of its doors"
