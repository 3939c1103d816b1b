"""Fuzzing of all that takes input from outside: `make fuzz`, see `tests/fuzz/__main__.py`."""
