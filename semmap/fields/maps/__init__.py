"""Representation maps: values by voxel, their operators and their export."""
