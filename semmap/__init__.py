"""semmap: one semantic map of an environment, kept in PostGIS."""
