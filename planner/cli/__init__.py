"""The commands of the planner: `semmap plan`, `route`, `topology`, `run`, `missions`, `robot`."""
