"""Folders for the clusters of tests; a later run removes those whose process was killed."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from semmap.database import Cluster, DatabaseError

PREFIX, LOCK = "semmap-test-", ".lock"

YOUNG = 60.0
"""Seconds within which a new lock file may not be locked yet."""


@contextlib.contextmanager
def cluster_folder(parent: Path) -> Iterator[Path]:
    """An empty folder that all users may enter, with a lock beside it while this process lives.

    In the end, the clusters in it are stopped, and it is removed.
    """
    number, name = tempfile.mkstemp(prefix=PREFIX, suffix=LOCK, dir=parent)
    with os.fdopen(number) as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        folder = Path(name).with_suffix("")
        folder.mkdir()
        folder.chmod(0o755)
        yield folder
        _stop_clusters(folder)
        # Hundreds of thousands of files: they go while other workers still test.
        subprocess.run(["sh", "-c", 'rm -rf "$0" "$1" &', folder, name], check=True)


def remove_abandoned(parent: Path, young: float = YOUNG) -> None:
    """Stop the servers and remove the folders of test processes that have died."""
    for path in parent.glob(f"{PREFIX}*{LOCK}"):
        with contextlib.suppress(OSError, DatabaseError):  # another process does the same
            if time.time() - path.stat().st_mtime < young:
                continue
            with path.open() as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                folder = path.with_suffix("")
                _stop_clusters(folder)
                shutil.rmtree(folder, ignore_errors=True)
                path.unlink()


def _stop_clusters(folder: Path) -> None:
    for data in (*folder.glob("data"), *folder.glob("*/data")):
        Cluster(data.parent).stop()
