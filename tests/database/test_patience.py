"""Commands wait for a server that starts, recovers or stops, and for no other."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from threading import Thread
from typing import Any

import psycopg
import pytest
from psycopg import pq
from sqlalchemy import URL

from semmap.database import Cluster, DatabaseError, open_engine
from semmap.database.programs import find_programs
from tests.database.conftest import as_owner, query


def plain(url: URL) -> str:
    return url.set(drivername="postgresql").render_as_string()


def shut_down_smartly(cluster: Cluster) -> None:
    """Let the server take no more sessions, and end with the last of those that it has."""
    os.kill(int((cluster.data / "postmaster.pid").read_text().split()[0]), signal.SIGTERM)


def wait_until_it_rejects(url: str) -> None:
    """Wait for the server to say that it takes no connections now."""
    deadline = time.monotonic() + 20
    while pq.PGconn.ping(url.encode()) != pq.Ping.REJECT:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def ask(url: Any) -> Any:
    engine = open_engine(url, migrate=False)
    with engine.connect() as connection:
        answer = connection.exec_driver_sql("SELECT 7").scalar()
    engine.dispose()
    return answer


@contextmanager
def later(seconds: float, action: Any) -> Iterator[None]:
    """Does it that much later, in another thread."""

    def wait_and_act() -> None:
        time.sleep(seconds)
        action()

    thread = Thread(target=wait_and_act)
    thread.start()
    yield
    thread.join()


@pytest.fixture
def address(own: Cluster, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The cluster as the embedded one, or by its URL."""
    url = own.ensure()
    if request.param == "url":
        return url
    monkeypatch.setenv("SEMMAP_DATA", str(own.home))
    return None


both = pytest.mark.parametrize("address", ["embedded", "url"], indirect=True)


@both
def test_recovery_is_waited_for(own: Cluster, address: Any) -> None:
    """A server whose backend was killed stops all others first, and it waits for a stopped one."""
    url = plain(own.ensure())
    with closing(psycopg.connect(url)) as session, closing(psycopg.connect(url)) as victim:
        stopped = session.info.backend_pid
        os.kill(stopped, signal.SIGSTOP)
        os.kill(victim.info.backend_pid, signal.SIGKILL)
        wait_until_it_rejects(url)
        with later(1, lambda: os.kill(stopped, signal.SIGCONT)):
            assert ask(address) == 7


@both
def test_shutdown_is_waited_for(own: Cluster, address: Any) -> None:
    url = plain(own.ensure())
    with closing(psycopg.connect(url)) as session:
        shut_down_smartly(own)
        wait_until_it_rejects(url)

        def restart() -> None:
            session.close()
            own.ensure()

        with later(1, restart):
            assert ask(address) == 7


def test_start_is_waited_for(own: Cluster) -> None:
    """A server that restores from an archive takes no connection until that is done."""
    url = own.ensure()
    own.stop()
    (own.home / "local.conf").write_text(
        "fsync = off\nhot_standby = off\nrestore_command = 'sleep 0.5; false'\n"
    )
    (own.data / "recovery.signal").touch()
    start = [find_programs()["pg_ctl"], "start", "-W", "-s", "-D", own.data, "-l", own.log]
    subprocess.run(start, check=True, cwd=own.home, **as_owner(own))
    wait_until_it_rejects(plain(url))
    assert ask(url) == 7


def test_server_that_is_away_for_a_moment(own: Cluster) -> None:
    url = own.ensure()
    own.stop()
    with later(1, own.ensure):
        assert ask(url) == 7


@pytest.mark.parametrize(
    ("change", "says", "seconds"),
    [
        ({"host": "127.0.0.1", "port": 1}, "Is the server running", 7),
        ({"query": {"host": "/no/such/folder"}}, "no socket directory", 1),
        ({"username": "games"}, "Peer authentication failed", 1),
        ({"database": "none"}, 'database "none" does not exist', 1),
    ],
)
def test_hopeless_connections_fail_soon(
    own: Cluster, change: dict[str, Any], says: str, seconds: float
) -> None:
    query(own, "SELECT 1")
    url = own.ensure()
    if "host" in change:
        url = URL.create(url.drivername)
    begin = time.monotonic()
    with pytest.raises(DatabaseError, match=says):
        open_engine(url.set(**change))
    assert time.monotonic() - begin < seconds


def test_patience_ends(own: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("semmap.database.patience.BUSY_SECONDS", 1.0)
    url = own.ensure()
    with closing(psycopg.connect(plain(url))):
        shut_down_smartly(own)
        wait_until_it_rejects(plain(url))
        with pytest.raises(DatabaseError, match=r"starting, recovering or stopping .* call again"):
            open_engine(url)
    while (own.data / "postmaster.pid").exists():
        time.sleep(0.01)
