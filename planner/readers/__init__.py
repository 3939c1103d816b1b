"""Database access of the planner, beside its modules `reader` and `planner.mission.store`."""
