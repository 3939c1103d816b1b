"""Fields in the database, in memory and as events between processes."""
