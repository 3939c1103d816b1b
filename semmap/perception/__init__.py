"""Perception of point clouds: table planes, clusters, shapes and known objects."""
