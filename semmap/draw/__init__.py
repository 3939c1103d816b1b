"""Pictures of the map as PNG: floor plans, 3D scenes, costmaps, fields.

All functions take arrays and plain dataclasses; none of them reads the database.
"""
