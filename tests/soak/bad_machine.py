"""A server whose clock jumps, and one whose disk is slow, while all processes work."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import semmap
from semmap.database import Cluster, open_engine
from tests.soak.clock import ABSENT, LIBRARY, movable_clock, preloaded
from tests.soak.disk import command
from tests.soak.kills import MIRRORED, OFFICE, Soak
from tests.soak.statements import UPDATE

JUMPS = 3, -2, 24, -5, 0
"""Hours."""

PATIENCE = 0.05, 0.5, 1.0, 3.0
"""Seconds for which a statement may last on a slow disk."""

READER_SECONDS = 5.0
"""Within which a reader is served while the disk is slow."""

SHIM = Path(__file__).with_name("slow_disk.c")


@contextmanager
def _soak(folder: Path, seed: int) -> Iterator[Soak]:
    """Few processes on a server that runs; both end."""
    soak = Soak(Cluster(folder / "home"), folder, OFFICE, seed)
    try:
        yield soak
    finally:
        soak.close()
        soak.cluster.stop()


def jumping_clock(folder: Path, seed: int, jumps: int = 12) -> list[str]:
    """Let the clock of the server jump by hours; returns what is wrong."""
    if LIBRARY is None:
        print(f"jumps of the clock are not tested: {ABSENT}")
        return []
    draw = Random(seed)
    with _soak(folder, seed) as soak:
        with movable_clock(folder) as set_clock:
            engine = open_engine(soak.cluster)
        with engine.begin() as connection:  # else a jump ahead ends what is kept
            connection.exec_driver_sql("UPDATE retention SET keep_for = '100 years'")
        soak.prepare(20, 3)
        for number in range(jumps):
            jump = draw.choice(JUMPS)
            set_clock(f"{jump:+}h")
            print(f"{number + 1:>5}  {soak.work(f'clock {jump:+} h', 3)}", flush=True)
            with engine.connect() as connection:
                now = connection.exec_driver_sql("SELECT extract(epoch FROM now())").scalar_one()
            if abs(float(now) - time.time() - 3600 * jump) > 60:
                soak.wrong.append(f"the clock of the server did not jump by {jump:+} h")
        engine.dispose()
        soak.finish()
    return soak.wrong


def slow_disk(folder: Path, seed: int, updates: int = 20) -> list[str]:
    """Let the disk of the server be slow, and kill it then; returns what is wrong."""
    compiler = shutil.which("cc")
    if compiler is None:
        print("a slow disk is not tested: there is no C compiler")
        return []
    shim, slow = folder / "slow_disk.so", folder / "slow"
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", shim, SHIM], check=True)
    with _soak(folder, seed) as soak:
        with preloaded(shim, {"SEMMAP_SLOW": str(slow)}):
            url = open_engine(soak.cluster).url.render_as_string(hide_password=False)
        soak.prepare(5, 3)  # a commit has the turn to move: more would wait for minutes
        slow.touch()
        try:
            print(f"       {soak.work('slow disk', 5)}", flush=True)
            wrong = command(soak.cluster, "maps")
            wrong += command(soak.cluster, "import", str(OFFICE[0]), "--map", "slow")
            begin = time.monotonic()
            with semmap.connect(url) as db:
                found = db.map(MIRRORED)
                for number in range(updates):
                    wrong += _hurried(found, PATIENCE[number % len(PATIENCE)])
            if time.monotonic() < begin + 0.2 * updates:
                wrong.append("the disk was not slow")
            print(f"       slow disk, {soak.kill('server')}", flush=True)
        finally:
            slow.unlink()
        soak.finish()
    return [*soak.wrong, *wrong]


def _hurried(found: semmap.Map, seconds: float) -> list[str]:
    """State a number in limited time: it is there, or an error says why it is not."""
    query = "SELECT ?n { :hurried <urn:soak:count> ?n }"
    begin = time.monotonic()
    before = [int(n) for (n,) in found.sparql(query)]
    if (waited := time.monotonic() - begin) > READER_SECONDS:
        return [f"a reader waited {waited:.1f} s for a slow disk"]
    number, refused = max(before, default=0) + 1, ""
    try:
        found.update(UPDATE.format("hurried", number), seconds=seconds)
    except semmap.Error as error:
        refused = str(error)
    after = [int(n) for (n,) in found.sparql(query)]
    print(f"       stated in {seconds:g} s: {refused or 'ok'}", flush=True)
    if after != (before if refused else [number]):
        return [f"{after} is there where {number} was stated: {refused or 'no error'}"]
    return []
