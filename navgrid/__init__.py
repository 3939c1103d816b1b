"""Occupancy grids from geometry: slabs, layers, inflation, map files."""
