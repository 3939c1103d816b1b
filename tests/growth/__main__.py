"""Move one entity 100,000 times beside programs that follow it, and print what all grow to.

    make growth                              an object of the example
    SEMMAP_GROWTH_MOVES=864000 make growth   a day of ten moves a second
    python -m tests.growth --kind agent --world rooms.geojson --world house.sdf

Ten moves stand for a second: the retention is shortened in the same ratio as the moves are faster,
to one version a second and to the last `--keep` seconds. The exit status is 1 if anything exceeds
the retention, still grows in the second half, or contradicts itself.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psycopg

import semmap
from semmap.database import Cluster, open_engine
from semmap.ingest.importer import import_file
from tests.growth.moves import RETENTION, TABLES, expired_changes, gaps, move, row, sizes, versions
from tests.growth.program import COMMAND, ROOT, Program
from tests.growth.requests import TOKEN, Requests

OFFICE = [ROOT / "examples/office" / name for name in ("office_rooms.geojson", "office.sdf")]
SECONDS_OF_MOVE = 0.1
ROWS = 10
"""Of the table that is printed."""

CHOSEN = """
SELECT e.id, e.name, w.pose[1:3] FROM entity e JOIN world w ON w.entity_id = e.id
JOIN placement p ON p.entity_id = e.id
WHERE e.kind = %s ORDER BY p.relation = 'on' DESC, e.name
"""
FIELDS = """
keep_every: 0.1
keep_for: 10
sources: {{gaze: {{percepts: {{recording: {recording}, loop: true}}, timeout: 1}}}}
"""
GAZES = [
    f"""{{"time": "2026-01-01T00:00:{second:04.1f}Z", "poses": """
    f"""{{"human1": {{"from": [1, 1, 1.6], "to": [{1 + second}, 2, 0.8]}}}}}}\n"""
    for second in (0.5, 1.0, 1.5, 4.0)
]
"""Looks of a person, which fade in the pause before the last."""

ROBOT = """
WITH made AS (INSERT INTO entity (map_id, kind, name)
              SELECT current_map(), 'agent', 'growing robot' RETURNING id)
INSERT INTO placement (entity_id, pose)
SELECT made.id, w.pose FROM made, world w JOIN room r ON r.entity_id = w.entity_id LIMIT 1
"""


def run(cluster: Cluster, worlds: list[Path], kind: str, moves: int, keep: float) -> list[str]:
    """Import, move and watch; returns what exceeds its bound."""
    (cluster.home / "local.conf").write_text("fsync = off\nautovacuum_naptime = 2s\n")
    engine = open_engine(cluster)
    for world in worlds:
        import_file(engine, world, map_name="growth")
    url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    before = check(url)
    tokens = cluster.home / "tokens"
    tokens.touch(0o600)
    tokens.write_text(f"{TOKEN} semmap_robot\n")
    data = {**os.environ, "SEMMAP_DATA": str(cluster.home)}
    serve = ("serve", "--port", "0", "--tokens", str(tokens))
    (cluster.home / "fields.yaml").write_text(FIELDS.format(recording=cluster.home))
    (cluster.home / "gaze.jsonl").write_text("".join(GAZES))
    fields = ("fields", "serve", "--config", str(cluster.home / "fields.yaml"))
    with (
        Program("-m", "tests.growth.follower", url, "growth") as follower,
        Program(*COMMAND, *serve, env=data, stderr=subprocess.STDOUT) as server,
        Program(*COMMAND, *fields, env=data, stderr=subprocess.STDOUT) as service,
        psycopg.connect(url, autocommit=True, options="-c search_path=semmap,public") as own,
    ):
        assert follower.line() == "ready\n"
        print(service.line(), end="")
        programs = {"follower": follower, "semmap serve": server, "fields serve": service}
        name, pose = row(own, CHOSEN, "object")[1:]
        with Requests(server.line().split("/maps")[0], name, pose) as requests:
            wrong = watch(own, programs, kind, moves, keep)
        print(f"{follower.ask()}; requests by status: {dict(requests.answers)}")
        wrong += requests.wrong
        # What stands beside it may be as near as the checks refuse.
        own.execute("SELECT move_to(entity_id(%s), %s, %s, %s)", [name, *pose])
    if check(url) != before:
        wrong.append(f"semmap check: {check(url)}")
    engine.dispose()
    return wrong


def watch(
    own: psycopg.Connection[Any],
    programs: dict[str, Program],
    kind: str,
    moves: int,
    keep: float,
) -> list[str]:
    """Move an entity, print a table, and return what exceeds its bound."""
    if kind == "agent":
        own.execute(ROBOT)
    entity, name, _ = row(own, CHOSEN, kind)
    start = time.monotonic()
    for _ in move(own, entity, 1000):
        pass
    ratio = (time.monotonic() - start) / 1000 / SECONDS_OF_MOVE
    own.execute(RETENTION, {"every": ratio, "keep": keep * ratio})
    own.execute("DELETE FROM placement_history")
    print(f"{name}: {moves:,} moves, {1 / ratio:.0f} times as fast as ten a second")
    head = ["moves", "a second", "versions", "changes", "dead rows", *(f"{t} MB" for t in TABLES)]
    head += [f"{name} MB, files" for name in programs]
    print(" ".join(f"{cell:>9}" for cell in head))

    wrong: list[str] = []
    half: dict[str, tuple[int, int]] = {}
    peaks = dict.fromkeys(programs, (0, 0))
    first = sizes(own)
    most = keep + 3
    start, last = time.monotonic(), 0
    for done in move(own, entity, moves, seed=1):
        for name, program in programs.items():
            memory, files = peaks[name]
            peaks[name] = max(memory, program.memory), max(files, program.files)
        if done % max(moves // ROWS, 100):
            continue
        took, start = time.monotonic() - start, time.monotonic()
        kept, changes = versions(own, entity), expired_changes(own)
        found = sizes(own)
        dead = sum(found[table][1] for table in TABLES)
        cells = [f"{done:,}", f"{(done - last) / took:.0f}", kept, found["change"][0], dead]
        cells += [f"{found[table][2] / 1e6:.1f}" for table in TABLES]
        used = {name: (program.memory, program.files) for name, program in programs.items()}
        cells += [f"{memory / 1e6:.0f}, {files}" for memory, files in used.values()]
        lines = zip(cells, head, strict=True)
        print(" ".join(f"{cell!s:>{max(9, len(name))}}" for cell, name in lines), flush=True)
        last = done
        if kept > most:
            wrong.append(f"{kept} versions are stored, the retention allows {most:.0f}")
        if changes > 2000:
            wrong.append(f"{changes} changes are stored longer than their retention")
        if not half and done >= moves / 2:
            half, stored = peaks, found
            peaks = dict.fromkeys(programs, (0, 0))
    wrong += [
        f"{table} grew from {stored[table][2]:,} to {size:,} bytes in the second half"
        for table, (_, _, size) in found.items()
        if size > 1.5 * stored[table][2] + 1e6
    ]
    wrong += [
        f"{name} grew from {half[name]} to {peaks[name]} bytes and open files at most"
        for name in programs
        if peaks[name][0] > half[name][0] + 20e6 or peaks[name][1] > half[name][1] + 20
    ]
    rows = {table: (first[table][0], now) for table, (now, _, _) in found.items()}
    print("more rows:", {table: pair for table, pair in rows.items() if pair[1] > pair[0]})
    if gaps(own):
        wrong.append(f"{gaps(own)} versions do not end where the next one begins")
    return wrong


def check(url: str) -> list[Any]:
    """Where the map contradicts itself."""
    with semmap.connect(url) as db:
        return [str(each) for each in db.map("growth").check() if each.severity == "error"]


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    moves = int(os.environ.get("SEMMAP_GROWTH_MOVES", "100000"))
    parser.add_argument("--moves", type=int, default=moves)
    parser.add_argument("--kind", choices=["object", "agent"], default="object")
    parser.add_argument("--keep", type=float, default=600, help="Seconds that are kept.")
    parser.add_argument("--world", type=Path, action="append", help="A file to import.")
    chosen = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="semmap-growth-", dir="/tmp"))
    folder.chmod(0o755)
    cluster = Cluster(folder / "home")
    cluster.home.mkdir()
    try:
        wrong = run(cluster, chosen.world or OFFICE, chosen.kind, chosen.moves, chosen.keep)
    finally:
        cluster.stop()
        shutil.rmtree(folder)
    print("\n".join(dict.fromkeys(wrong)) or "all within the retention")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
