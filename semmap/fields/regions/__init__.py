"""Regions: shapes, their voxels, and measures between them."""
