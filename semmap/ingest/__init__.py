"""World files in: one module a format, each a function from a path to a `World`."""
