"""Commands on small_house without a service, in processor time: each is a process of its own.

`SEMMAP_WORLDS` names the folder of the worlds. The first query makes and keeps the voxels; it is
not counted.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
from pathlib import Path

from benchmarks.bench_map import use_bench_database
from benchmarks.timing import Row, print_rows

MAP = "bench house"
WORLD = "small_house/worlds/small_house.world"
ROOMS = Path(__file__).parents[1] / "tests/worlds/small_house_rooms.geojson"
LIMIT = 0.5

LIBRARIES = "numpy", "psycopg", "rdflib.plugins.sparql", "semmap_vdb", "typer"

COMMANDS = (
    ("ls",),
    ("fields", "ls"),
    ("fields", "kept"),
    ("fields", "at", "6.5,-1,0.5"),
    ("fields", "query", "ASK { ?o a :refrigerator ; :in :kitchen }"),
    ("fields", "query", "SELECT (COUNT(?v) AS ?n) { ?v :occupiedBy ?o }"),
    ("fields", "query", "SELECT ?o ?r { ?o :in ?r }"),
    ("fields", "query", "SELECT ?v { ?v :inRoom :kitchen }"),
)


def main() -> None:
    """Measure the commands."""
    worlds = os.environ.get("SEMMAP_WORLDS")
    if worlds is None:
        sys.exit("set SEMMAP_WORLDS to the folder of the worlds")
    use_bench_database()
    program = [sys.executable, "-c", "from semmap.cli import main; main()"]
    for file in (Path(worlds, WORLD), ROOMS):
        _run([*program, "import", str(file), "--map", MAP])
    try:
        imports = _processor_seconds([sys.executable, "-c", f"import {', '.join(LIBRARIES)}"])
        rows = [
            Row(
                f"semmap {' '.join(command)}",
                f"{seconds:.2f} s",
                f"libraries {imports:.2f} s",
                f"at most {LIMIT} s",
                seconds <= LIMIT,
            )
            for command in COMMANDS
            for seconds in [_processor_seconds([*program, *command, "--map", MAP])]
        ]
    finally:
        _run([*program, "drop", MAP, "--yes"])
    print_rows("commands on small_house, no service, processor time", rows)


def _processor_seconds(command: list[str], times: int = 9) -> float:
    _run(command)
    seconds = []
    for _ in range(times):
        before = _used()
        _run(command)
        seconds.append(_used() - before)
    return statistics.median(seconds)


def _used() -> float:
    """Processor time of the processes that ended, in seconds."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(command[3:])}: {done.stderr}")
