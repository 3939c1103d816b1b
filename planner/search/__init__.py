"""Search for objects whose place is only believed (O'Neill, Semantic Maps for Domestic Robots)."""
