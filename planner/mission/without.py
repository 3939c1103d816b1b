"""A topology without what a mission does without."""

from __future__ import annotations

from collections.abc import Collection

from planner.topology import Topology

__all__ = ["topology_without"]


def topology_without(topology: Topology, names: Collection[str]) -> Topology:
    """The topology without these connectors, and without the doors of these elevators."""
    shut = {
        place for lift, cabins in topology.cabins().items() if lift in names for place in cabins
    }
    left = [
        c
        for c in topology.connectors.values()
        if c.name not in names and not shut.intersection(c.places)
    ]
    return Topology.of(topology.places.values(), left)
