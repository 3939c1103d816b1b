"""The T-Box: semantic types from ontologies."""
