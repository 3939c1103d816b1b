"""Worlds into the database."""
