"""Topology, routes and tasks over the semantic map."""
