"""What follows from the facts and the ontology by RDFS and OWL 2 RL, kept up to date.

`runs` begins them; `rules` and `axioms` say what follows, `closure` and `engine` find it.
"""
