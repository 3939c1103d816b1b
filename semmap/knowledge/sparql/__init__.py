"""SPARQL 1.1 and GeoSPARQL 1.1 as SQL: triple patterns, paths, expressions, and whole queries."""
