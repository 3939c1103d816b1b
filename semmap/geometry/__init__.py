"""Poses, meshes and footprints: arrays and plain dataclasses, no database."""
