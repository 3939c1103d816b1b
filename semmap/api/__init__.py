"""The public face of semmap: a database, its maps, their entities, their changes."""
