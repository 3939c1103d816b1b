"""What happens to a cluster in a round, each a function that returns when it is over."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from uuid import uuid4

import psycopg

from tests.failover.cluster import FailoverCluster
from tests.failover.writers import Writers, commits

SHORT = 8
"""Seconds that a failure lasts which needs no new primary."""


FOLLOWERS = """
SELECT count(*) FROM pg_stat_replication
WHERE pg_wal_lsn_diff(pg_current_wal_lsn(), flush_lsn) < 64 * 1024 * 1024
"""


def wait_for_writes(writers: Writers, seconds: float = 90) -> None:
    """Wait until writes have been acknowledged for a second."""
    begun = time.monotonic()
    while time.monotonic() < begun + seconds:
        since = time.monotonic()
        time.sleep(1)
        if writers.since(since) > 2:
            return
    raise TimeoutError(f"no writes for {seconds} s")


def kill_primary(cluster: FailoverCluster, writers: Writers) -> None:
    """The primary's container is killed and comes back when another one is the primary."""
    killed = cluster.primary()
    cluster.kill(killed)
    wait_for_writes(writers)
    cluster.revive(killed)


def kill_server(cluster: FailoverCluster, writers: Writers) -> None:
    """The primary's server process is killed; its container goes on."""
    command = 'kill -9 "$(head -1 "$PGDATA/postmaster.pid")"'
    cluster.execute(cluster.primary(), "bash", "-c", command)
    wait_for_writes(writers)


def isolate_primary(cluster: FailoverCluster, writers: Writers) -> None:
    """The primary is cut off from the others, but not from clients."""
    isolated = cluster.primary()
    with cluster.cut_off(isolated):
        _cancel_a_commit(cluster, isolated, writers)
        wait_for_writes(writers)


def _cancel_a_commit(cluster: FailoverCluster, isolated: str, writers: Writers) -> None:
    """Cancel a commit that waits on the isolated side: it must not count as acknowledged."""
    time.sleep(1)
    row = {"id": f"cancelled-{uuid4()}", "writer": 99}
    try:
        with psycopg.connect(cluster.url_of(isolated), connect_timeout=2) as connection:
            threading.Timer(0.5, connection.cancel).start()
            assert not commits(connection, row), "a commit was acknowledged on the isolated side"
            writers.notices += 1
    except psycopg.Error:
        pass  # the server has been stopped already


def isolate_standby(cluster: FailoverCluster, writers: Writers) -> None:
    """A standby is cut off for a while."""
    with cluster.cut_off(cluster.standbys()[0]):
        time.sleep(SHORT)


def pause_standby(cluster: FailoverCluster, writers: Writers) -> None:
    """A standby stands still for a while, its connections open."""
    standby = cluster.standbys()[0]
    cluster.pause(standby)
    time.sleep(SHORT)
    cluster.resume(standby)


def fill_standby(cluster: FailoverCluster, writers: Writers) -> None:
    """A standby's disk is full for a while."""
    standby = next(name for name in cluster.standbys() if name in cluster.small)
    cluster.fill(standby)
    with psycopg.connect(cluster.url, autocommit=True) as connection:
        deadline = time.monotonic() + 60
        while connection.execute(FOLLOWERS).fetchone() != (len(cluster.nodes) - 2,):
            assert time.monotonic() < deadline, f"{standby} follows with a full disk"
            connection.execute("SELECT pg_switch_wal()")  # the standby needs one more file
            time.sleep(0.5)
    time.sleep(SHORT)
    cluster.make_room(standby)


def kill_monitor(cluster: FailoverCluster, writers: Writers) -> None:
    """The monitor is down for a while."""
    cluster.kill("monitor")
    time.sleep(SHORT)
    cluster.revive("monitor")


def switch_over(cluster: FailoverCluster, writers: Writers) -> None:
    """The primary becomes a standby by command."""
    cluster.execute("monitor", "pg_autoctl", "perform", "switchover")
    wait_for_writes(writers)


FAILURES: dict[str, Callable[[FailoverCluster, Writers], None]] = {
    "kill -9 of the primary": kill_primary,
    "kill -9 of its server process": kill_server,
    "primary cut off, clients reach it": isolate_primary,
    "standby cut off": isolate_standby,
    "standby stands still": pause_standby,
    "disk of a standby full": fill_standby,
    "monitor down": kill_monitor,
    "switchover": switch_over,
}
