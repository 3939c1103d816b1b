"""SPARQL 1.1 and GeoSPARQL 1.1 as SQL: triple patterns, paths, expressions, and whole queries.

`translator` makes a statement of an algebra, `kept_queries` runs those that were asked before.
"""
