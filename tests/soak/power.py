"""A power cut: pages that were written in part since a checkpoint, and a log whose end is lost.

A disk writes sectors of 512 bytes, and of what was not flushed any of them, in any order. A page of
a table is 8 kB: after a cut it may be the former one, the new one, or sectors of both.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from random import Random

import numpy as np
import psycopg

from semmap.database import Cluster
from semmap.database.programs import find_programs

PAGE, SECTOR, SEGMENT = 8192, 512, 16 << 20
TORN = "base", "global", "pg_xact", "pg_multixact"
WHOLE = "pg_control", "pg_internal.init"

SOON = """
shared_buffers = 2MB
bgwriter_delay = 10ms
bgwriter_lru_maxpages = 1000
bgwriter_lru_multiplier = 10
"""


def small_buffers(cluster: Cluster, settings: str = "") -> None:
    """Restart a server with so few buffers that it writes changed pages before a checkpoint."""
    cluster.ensure()
    cluster.stop()
    (cluster.home / "local.conf").write_text(SOON + settings)
    cluster.ensure()


def copy_pages(data: Path, copy: Path) -> None:
    """Copy the pages of the tables, as they are after a checkpoint."""
    for name in TORN:
        shutil.copytree(data / name, copy / name)


def cut(data: Path, copy: Path, flushed: int, draw: Random) -> int:
    """Leave what a disk may have after a power cut; returns how many pages are torn.

    Of pages that changed since `copy`, some sectors are former ones. The log has no more than its
    first `flushed` bytes, and what pages need that were written: a server writes the log before.
    """
    choose = np.random.default_rng(draw.getrandbits(32))
    torn = 0
    for file in (each for name in TORN for each in (data / name).rglob("*") if each.is_file()):
        former, size = copy / file.relative_to(data), file.stat().st_size
        if file.name in WHOLE or size % PAGE or not size:
            continue
        new = np.fromfile(file, np.uint8).reshape(-1, PAGE // SECTOR, SECTOR)
        if file.parent.parent.name == "base":
            high, low = new[:, 0, :8].copy().view("<u4").T.astype(np.int64)
            flushed = max(flushed, int(((high << 32) + low).max()))
        if not former.exists():  # a new file is flushed when it is made
            continue
        was = np.zeros_like(new)
        kept = np.fromfile(former, np.uint8)[: new.size]
        was.reshape(-1)[: len(kept)] = kept
        part = choose.choice([0.0, 0.5, 1.0], size=(len(new), 1))  # the former page, both, the new
        mixed = np.where((choose.random(new.shape[:2]) < part)[..., None], new, was)
        torn += int(((mixed != new).any((1, 2)) & (mixed != was).any((1, 2))).sum())
        with file.open("r+b") as opened:
            opened.write(mixed.tobytes())
    _lose_log(data / "pg_wal", flushed, draw)
    return torn


def _lose_log(folder: Path, flushed: int, draw: Random) -> None:
    """Overwrite the log after a position with zeros, or with anything."""
    for file in (each for each in folder.iterdir() if len(each.name) == 24):
        begin = (int(file.name[8:16], 16) << 32) + int(file.name[16:], 16) * SEGMENT
        start = max(flushed - begin, 0)
        if start < SEGMENT:
            with file.open("r+b") as opened:
                opened.seek(start)
                opened.write(draw.choice((bytes, draw.randbytes))(SEGMENT - start))


def log_position(connection: psycopg.Connection) -> tuple[int, int]:
    """Return where the log is flushed to, and where its newest checkpoint begins, in bytes."""
    row = connection.execute(
        "SELECT pg_current_wal_flush_lsn() - '0/0', redo_lsn - '0/0' FROM pg_control_checkpoint()"
    ).fetchone()
    assert row is not None
    return int(row[0]), int(row[1])


def damaged(cluster: Cluster) -> list[str]:
    """Stop the server; return what PostgreSQL's own checks find in tables, indexes and pages."""
    url = cluster.ensure().set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("CREATE EXTENSION IF NOT EXISTS amcheck")
        wrong = [str(row) for row in connection.execute(HEAPS)]
        for (index,) in connection.execute(INDEXES).fetchall():
            try:
                connection.execute("SELECT bt_index_check(%s, true)", (index,))
            except psycopg.Error as error:
                wrong.append(str(error))
    cluster.stop()
    done = subprocess.run(
        [find_programs()["pg_checksums"], "--check", "-D", cluster.data],
        capture_output=True,
        text=True,
        check=False,
    )
    return [*wrong, done.stderr] if done.returncode else wrong


HEAPS = (
    "SELECT c.relname, v.blkno, v.msg FROM pg_class c, LATERAL verify_heapam(c.oid) v "
    "WHERE c.relkind IN ('r', 't', 'm') AND c.relpersistence = 'p'"
)
INDEXES = (
    "SELECT c.oid FROM pg_class c JOIN pg_am a ON a.oid = c.relam "
    "JOIN pg_index i ON i.indexrelid = c.oid WHERE a.amname = 'btree' AND i.indisvalid "
    "AND c.relkind = 'i' AND c.relpersistence = 'p'"
)
