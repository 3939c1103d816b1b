"""Fields in the graph: queries of them, and their relations as facts."""
