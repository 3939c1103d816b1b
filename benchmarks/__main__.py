"""`make bench`: all the speed tables, or those named: ``python -m benchmarks database``.

Those of `ALONE` take long, and run only if they are named.
"""

from __future__ import annotations

import importlib
import sys

TABLES = (
    "database",
    "inventory",
    "events",
    "meshes",
    "slabs",
    "voxel_grids",
    "inflation",
    "costmap",
    "fields",
    "commands",
    "relations",
    "pairs",
    "language",
    "routes",
    "topology",
    "plans",
    "search",
    "belief",
    "belief_store",
    "learned_beliefs",
    "manipulation",
    "perception",
    "knowledge",
    "stated",
    "endpoint",
    "questions",
    "subscriptions",
    "reasoning",
    "interlinking",
    "manipulation_actions",
)

ALONE = ("chain", "fetch", "grasp_experiment", "grasping", "hours", "openings", "solvers")

unknown = [name for name in sys.argv[1:] if name not in TABLES + ALONE]
if unknown:
    sys.exit(f"there is no table {', '.join(unknown)}: there are {', '.join(TABLES + ALONE)}")
for name in sys.argv[1:] or TABLES:
    importlib.import_module(f"benchmarks.{name}").main()
