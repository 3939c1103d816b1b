"""SPARQL 1.1 with STORE, AT and DURING, and reMap's notation: parsed and checked."""
