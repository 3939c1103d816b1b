"""Qualitative relations between regions, and their events."""
