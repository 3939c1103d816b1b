"""The map for programs of others: the table of operations over the Model Context Protocol."""
