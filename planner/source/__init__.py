"""The database as planners see it: nothing else in `planner` asks it about topology and robots."""
