"""`make bench`: all the speed tables, or those named: ``python -m benchmarks database``.

``grasp_experiment`` takes long, and runs only if it is named.
"""

from __future__ import annotations

import importlib
import sys

TABLES = (
    "database",
    "inventory",
    "meshes",
    "slabs",
    "inflation",
    "costmap",
    "fields",
    "relations",
    "language",
    "routes",
    "topology",
    "plans",
    "search",
    "belief",
    "belief_store",
    "manipulation",
    "perception",
    "knowledge",
    "subscriptions",
    "reasoning",
    "interlinking",
    "manipulation_actions",
)

for name in sys.argv[1:] or TABLES:
    importlib.import_module(f"benchmarks.{name}").main()
