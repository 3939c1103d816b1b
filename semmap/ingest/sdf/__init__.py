"""Gazebo worlds and models in SDF."""
