"""Rooms, doors, regions and properties that people draw as map features."""

from semmap.ingest.annotation.annotation import read_annotation

__all__ = ["read_annotation"]
