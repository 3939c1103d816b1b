"""The SPARQL front end: it parses a text and checks it against a schema, for any back end.

A back end gives a `Schema` (its properties, and the entities that names stand for) and evaluates
the checked algebra. The back end for fields is `semmap.fields.queries`. The language is SPARQL 1.1
with the clauses STORE, AT and DURING; it accepts the notation of reMap (section 4), too.
"""
