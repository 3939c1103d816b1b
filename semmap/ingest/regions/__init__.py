"""Regions of a map: drawn, or found in the geometry."""
