"""Rooms, doors, regions and properties that people draw as map features."""
