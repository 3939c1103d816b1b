"""What the server of `tests.forked` imports, so that the processes forked from it need not."""

import semmap.cli.application
import semmap.cli.output
import semmap.cli.route
import semmap.cli.topology
import semmap.ingest.importer
import tests.planner.mission.runs

__all__ = ["semmap", "tests"]
