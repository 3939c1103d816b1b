"""What follows from facts and ontology by RDFS and OWL 2 RL, kept up to date: `runs` begins it."""
