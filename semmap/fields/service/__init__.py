"""The service of fields: it follows a map, runs sources, and answers on a local socket."""
