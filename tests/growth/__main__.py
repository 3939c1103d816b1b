"""Move one entity 100,000 times, and print what the database and a follower grow to.

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
from tests.growth.moves import RETENTION, TABLES, expired_changes, gaps, move, sizes, versions

ROOT = Path(__file__).parents[2]
OFFICE = [ROOT / "examples/office" / name for name in ("office_rooms.geojson", "office.sdf")]
SECONDS_OF_MOVE = 0.1
ROWS = 10
"""Of the table that is printed."""

CHOSEN = """
SELECT e.id, e.name FROM entity e JOIN world w ON w.entity_id = e.id
JOIN placement p ON p.entity_id = e.id
WHERE e.kind = %s ORDER BY p.relation = 'on' DESC, e.name LIMIT 1
"""
ROBOT = """
WITH made AS (INSERT INTO entity (map_id, kind, name)
              SELECT current_map(), 'agent', 'growing robot' RETURNING id)
INSERT INTO placement (entity_id, pose)
SELECT made.id, w.pose FROM made, world w JOIN room r ON r.entity_id = w.entity_id LIMIT 1
"""


def resident(process: subprocess.Popen[str]) -> int:
    """Bytes of memory that a process has."""
    pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGESIZE")


def ask(process: subprocess.Popen[str]) -> int:
    """How many looks the follower has had at the map."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write("\n")
    process.stdin.flush()
    return int(process.stdout.readline())


def run(cluster: Cluster, worlds: list[Path], kind: str, moves: int, keep: float) -> list[str]:
    """Import, move and watch; returns what exceeds its bound."""
    (cluster.home / "local.conf").write_text("fsync = off\nautovacuum_naptime = 2s\n")
    engine = open_engine(cluster)
    for world in worlds:
        import_file(engine, world, map_name="growth")
    url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    before = check(url)
    follower = subprocess.Popen(
        [sys.executable, "-m", "tests.growth.follower", url, "growth"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    assert follower.stdout is not None
    try:
        assert follower.stdout.readline() == "ready\n"
        with psycopg.connect(url, autocommit=True, options="-c search_path=semmap,public") as own:
            wrong = watch(own, follower, kind, moves, keep)
    finally:
        follower.kill()
        follower.wait()
    if check(url) != before:
        wrong.append(f"semmap check: {check(url)}")
    engine.dispose()
    return wrong


def watch(
    own: psycopg.Connection[Any],
    follower: subprocess.Popen[str],
    kind: str,
    moves: int,
    keep: float,
) -> list[str]:
    """Move an entity, print a table, and return what exceeds its bound."""
    if kind == "agent":
        own.execute(ROBOT)
    chosen = own.execute(CHOSEN, [kind]).fetchone()
    assert chosen is not None, f"the map has no {kind}"
    entity, name = chosen
    start = time.monotonic()
    for _ in move(own, entity, 1000):
        pass
    ratio = (time.monotonic() - start) / 1000 / SECONDS_OF_MOVE
    own.execute(RETENTION, {"every": ratio, "keep": keep * ratio})
    own.execute("DELETE FROM placement_history")
    print(f"{name}: {moves:,} moves, {1 / ratio:.0f} times as fast as ten a second")
    head = ["moves", "a second", "versions", "changes", *(f"{t} MB" for t in TABLES), "dead rows"]
    print("".join(f"{cell:>22}" if "MB" in cell else f"{cell:>11}" for cell in head), "follower MB")

    wrong: list[str] = []
    half: tuple[dict[str, int], int] | None = None
    most = keep + 3
    start, last = time.monotonic(), 0
    for done in move(own, entity, moves, seed=1):
        if done % max(moves // ROWS, 100):
            continue
        took, start = time.monotonic() - start, time.monotonic()
        kept, changes = versions(own, entity), expired_changes(own)
        found = sizes(own)
        memory = resident(follower)
        cells = [f"{done:,}", f"{(done - last) / took:.0f}", kept, found["change"][0]]
        size = {table: found[table][2] for table in TABLES}
        line = "".join(f"{cell!s:>11}" for cell in cells)
        line += "".join(f"{each / 1e6:>22.1f}" for each in size.values())
        dead = sum(found[table][1] for table in TABLES)
        print(f"{line}{dead:>11} {memory / 1e6:.0f} after {ask(follower):,} looks", flush=True)
        last = done
        if kept > most:
            wrong.append(f"{kept} versions are stored, the retention allows {most:.0f}")
        if changes > 2000:
            wrong.append(f"{changes} changes are stored longer than their retention")
        if half is None and done >= moves / 2:
            half = size, memory
    if half is not None:
        wrong += [
            f"{table} grew from {half[0][table]:,} to {size[table]:,} bytes in the second half"
            for table in TABLES
            if size[table] > 1.5 * half[0][table] + 1e6
        ]
        if memory > half[1] + 20e6:
            wrong.append(f"the follower grew from {half[1]:,} to {memory:,} bytes")
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
