"""Gazebo worlds and models in SDF."""

from semmap.ingest.sdf.world_file import read_sdf

__all__ = ["read_sdf"]
