"""Standing queries: what begins and ceases to be an answer as the map changes."""
