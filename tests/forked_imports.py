"""What the server of `tests.forked` imports, so that the processes forked from it need not."""

import planner.cli.route
import planner.cli.topology
import semmap.cli.application
import semmap.cli.output
import semmap.ingest.importer
import tests.planner.mission.runs

__all__ = ["planner", "semmap", "tests"]
