"""Spatial and semantic questions to the map."""
