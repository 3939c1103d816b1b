"""A cluster on a disk that becomes full, and on one that becomes read-only."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psycopg
from sqlalchemy.exc import DBAPIError

from semmap.database import Cluster, DatabaseError, open_engine
from semmap.ingest.importer import import_file
from tests.soak.actors import IMPORTED
from tests.soak.invariants import signature, violations
from tests.soak.kills import boxes

MEGABYTES = 400
COMMAND = [sys.executable, "-c", "from semmap.cli import main; main()"]


@contextmanager
def small_disk(megabytes: int = MEGABYTES) -> Iterator[Path | None]:
    """A folder on a disk of its own; None for users that cannot mount one."""
    folder = Path(tempfile.mkdtemp(prefix="semmap-disk-", dir="/tmp"))
    options = f"size={megabytes}m,mode=755"
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], capture_output=True, check=False
    )
    try:
        yield folder if mounted.returncode == 0 else None
    finally:
        if mounted.returncode == 0:
            Cluster(folder / "home").stop()
            while subprocess.run(["umount", folder], check=False).returncode:
                time.sleep(0.1)  # processes of the server are about to end
        folder.rmdir()


def full_disk(folder: Path) -> list[str]:
    """Import until the disk is full, and again when it has room; returns what is wrong."""
    cluster = Cluster(folder / "home")
    files = [boxes(folder / f"boxes{i}.sdf", range(5 * i, 20 + 5 * i)) for i in range(2)]
    engine = open_engine(cluster)
    versions = set()
    for file in (*files, *files):
        import_file(engine, file, map_name=IMPORTED, source="versions")
        with engine.connect() as connection:
            versions.add(signature(connection, IMPORTED))
    filler = fill(folder)
    refused = 0
    for i in range(40):
        big = boxes(Path(tempfile.mkdtemp(dir="/tmp")) / "big.sdf", range(1000))
        try:
            import_file(engine, big, map_name=f"big{i}")
        except (DBAPIError, psycopg.Error, DatabaseError):
            refused += 1
            break
    wrong = [] if refused else ["the full disk was not full"]
    wrong += command(cluster, "maps") + command(cluster, "import", str(big), "--map", "big")
    filler.unlink()
    engine.dispose()
    engine = open_engine(cluster)
    wrong += violations(engine, folder, IMPORTED, versions)
    import_file(engine, files[0], map_name=IMPORTED, source="versions")
    engine.dispose()
    return [f"on a full disk: {each}" for each in wrong]


def fill(folder: Path) -> Path:
    """Write a file until the disk is full."""
    filler = folder / "filler"
    with filler.open("wb", buffering=0) as file, suppress(OSError):
        while file.write(bytes(1 << 16)):
            pass
    return filler


def read_only_disk(folder: Path) -> list[str]:
    """Run commands on a disk that is read-only, and then is not; returns what is wrong."""
    cluster = Cluster(folder / "home")
    engine = open_engine(cluster)
    with engine.connect() as connection:
        before = signature(connection, IMPORTED)
    engine.dispose()
    cluster.stop()
    subprocess.run(["mount", "-o", "remount,ro", folder], check=True)
    wrong = command(cluster, "maps") + command(cluster, "import", str(folder / "boxes0.sdf"))
    subprocess.run(["mount", "-o", "remount,rw", folder], check=True)
    engine = open_engine(cluster)
    wrong += violations(engine, folder, IMPORTED, {before})
    engine.dispose()
    return [f"on a read-only disk: {each}" for each in wrong]


def command(cluster: Cluster, *arguments: str) -> list[str]:
    """Run a command of `semmap`: it succeeds, or says in an error what is wrong."""
    done = subprocess.run(
        [*COMMAND, *arguments],
        env={**os.environ, "SEMMAP_DATA": str(cluster.home)},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    if "Traceback" in done.stderr:
        return [f"semmap {arguments[0]} ends in a traceback: {done.stderr[-1500:]}"]
    print(f"       semmap {arguments[0]}: {done.returncode}, {done.stderr.strip()[:300] or 'ok'}")
    return []
