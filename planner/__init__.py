"""Topology, routes and tasks over the semantic map."""

from planner.topology import Topology

__all__ = ["Topology"]
