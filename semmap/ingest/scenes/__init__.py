"""Scenes of named nodes: mesh files, USD, MuJoCo's MJCF and URDF."""
