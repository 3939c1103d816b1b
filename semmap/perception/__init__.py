"""Perception of point clouds: table planes, clusters, shapes and known objects.

Modules take and return arrays; nothing here uses the map.
"""
