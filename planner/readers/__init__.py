"""Database access of the planner: no other module here but `*.reader` and `*.stores` has SQL."""
