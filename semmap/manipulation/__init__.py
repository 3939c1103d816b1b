"""Manipulation (Tosello et al.): grasps, pushes and places, from shapes and from experience."""
