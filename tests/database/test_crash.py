"""A cluster whose server was killed comes back with every committed change."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import httpx
import psycopg
import pytest
from sqlalchemy import Connection, create_engine

import semmap
from semmap.database import Cluster, open_engine
from semmap.database.leftovers import servers_in
from semmap.query.entity_query import changes_since
from tests.database.conftest import as_owner, python, query, said
from tests.database.test_embedded import ENSURE
from tests.served import served

COMMAND = """
import sys
sys.argv = ["semmap", "maps"]
from semmap.cli import main
main()
"""

ZOMBIE = """
import ctypes, json, os, signal, sys, time
from pathlib import Path
from semmap.database import Cluster, open_engine

def state(pid):
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]

PR_SET_CHILD_SUBREAPER = 36
assert ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) == 0
cluster = Cluster(Path(sys.argv[1]))
cluster.ensure()
killed = int((cluster.data / "postmaster.pid").read_text().split()[0])
os.kill(killed, signal.SIGKILL)
while state(killed) != "Z":
    time.sleep(0.01)
while (running := cluster.running()) is not None:  # what it had just forked has its socket, too
    time.sleep(0.01)
cluster.ensure()
after = int((cluster.data / "postmaster.pid").read_text().split()[0])
print(json.dumps([running, state(killed), state(after) in "SRD", killed != after]))
cluster.stop()
"""
"""A server whose parent is this process, which does not wait for it: killed, it stays a zombie."""

BUSY = b"SELECT count(*) FROM generate_series(1, 1000000000000) a"
"""It never looks whether its server still lives."""


def kill_server(cluster: Cluster) -> int:
    """Kill the server with -9, as the kernel does; returns its number."""
    pid = int((cluster.data / "postmaster.pid").read_text().split()[0])
    os.kill(pid, signal.SIGKILL)
    while Path(f"/proc/{pid}").exists():
        time.sleep(0.01)
    return pid


def wait_until_gone(cluster: Cluster) -> None:
    while servers_in(cluster.data):
        time.sleep(0.01)


def test_requests_are_told_to_try_again(own: Cluster) -> None:
    admin = {"Authorization": "Bearer a-token-of-an-admin"}
    tokens = {"a-token-of-an-admin": "semmap_admin"}
    with semmap.connect(own, migrate=True) as database, served(database, tokens) as url:
        for headers in ({}, admin):
            assert httpx.get(f"{url}/maps", headers=headers).status_code == 200
        kill_server(own)
        for headers in ({}, admin) * 3:
            began = time.monotonic()
            answer = httpx.get(f"{url}/maps", headers=headers, timeout=30)
            assert (answer.status_code, answer.headers.get("retry-after")) == (503, "1")
            assert time.monotonic() - began < 0.5
        own.ensure()
        for headers in ({}, admin):
            assert httpx.get(f"{url}/maps", headers=headers).status_code == 200


def test_committed_rows_outlive_the_server(own: Cluster) -> None:
    engine = create_engine(own.ensure())
    with engine.begin() as connection:
        connection.exec_driver_sql("CREATE TABLE kept (value int)")
    for value in range(20):
        with engine.begin() as connection:
            connection.exec_driver_sql("INSERT INTO kept VALUES (%s)", (value,))
    open_transaction = engine.connect()
    open_transaction.exec_driver_sql("INSERT INTO kept VALUES (1000)")
    kill_server(own)
    open_transaction.invalidate()
    engine.dispose()
    assert query(own, "SELECT array_agg(value ORDER BY value) FROM kept") == list(range(20))


def driver(connection: Connection) -> psycopg.Connection[Any]:
    return connection.connection.driver_connection  # type: ignore[return-value]


def test_a_cursor_outlives_the_server(own: Cluster) -> None:
    """A crashed server gives the number of a transaction that was undone to another one."""
    engine = open_engine(own.ensure())
    with engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO map (name) VALUES ('m')")
    with engine.connect() as connection:
        connection.exec_driver_sql("SELECT pg_current_xact_id()")
        connection.rollback()
    with engine.begin() as connection:
        cursor, _ = changes_since(driver(connection), None)
    kill_server(own)
    engine.dispose()
    engine = open_engine(own.ensure())
    with engine.begin() as connection:
        connection.exec_driver_sql(
            "INSERT INTO entity (map_id, kind, name) SELECT id, 'object', 'mug' FROM map"
        )
    with engine.begin() as connection:
        _, rows = changes_since(driver(connection), cursor)
    assert [row["what"] for row in rows] == ["added"]
    engine.dispose()


def test_orphans_make_way(own: Cluster) -> None:
    query(own, "CREATE TABLE kept AS SELECT 7 AS value")
    url = own.ensure().set(drivername="postgresql").render_as_string()
    busy = psycopg.connect(url)
    orphan = busy.info.backend_pid
    busy.pgconn.send_query(BUSY)
    time.sleep(0.2)
    kill_server(own)
    time.sleep(0.2)
    assert orphan in servers_in(own.data)
    assert query(own, "SELECT value FROM kept") == 7
    assert orphan not in servers_in(own.data)
    busy.close()


def test_number_that_another_process_has_got(own: Cluster) -> None:
    query(own, "CREATE TABLE kept AS SELECT 7 AS value")
    kill_server(own)
    wait_until_gone(own)
    with subprocess.Popen(["sleep", "60"], **as_owner(own)) as sleeper:
        file = own.data / "postmaster.pid"
        lines = file.read_text().splitlines()
        file.write_text("\n".join([str(sleeper.pid), *lines[1:]]) + "\n")
        assert query(own, "SELECT value FROM kept") == 7
        assert sleeper.poll() is None
        sleeper.kill()


@pytest.fixture
def sleeper(own: Cluster) -> Iterator[int]:
    """The number of a process of the user that the server runs as."""
    with subprocess.Popen(["sleep", "600"], **as_owner(own)) as process:
        yield process.pid
        assert process.poll() is None
        process.kill()


@pytest.mark.parametrize("content", ["{sleeper}\n{rest}", "", "{sleeper}", "0\n", "nonsense\n"])
@pytest.mark.parametrize("name", ["data/postmaster.pid", "run/.s.PGSQL.5432.lock"])
def test_stale_lock_file(own: Cluster, sleeper: int, name: str, content: str) -> None:
    query(own, "CREATE TABLE kept AS SELECT 7 AS value")
    kill_server(own)
    wait_until_gone(own)
    file = own.home / name
    rest = file.read_text().partition("\n")[2]
    file.write_text(content.format(sleeper=sleeper, rest=rest))
    assert query(own, "SELECT value FROM kept") == 7


def test_a_zombie_does_not_count_as_a_server(own: Cluster) -> None:
    process = python(ZOMBIE, own.home)
    assert said(process) == [None, "Z", True, True]


def test_a_shell_in_the_data_directory_is_not_stopped(own: Cluster) -> None:
    own.ensure()
    kill_server(own)
    shell = subprocess.Popen(["sleep", "600"], cwd=own.data, **as_owner(own))
    assert query(own, "SELECT 7") == 7
    assert shell.poll() is None
    shell.kill()
    shell.wait()


def test_orphan_that_hears_nothing(own: Cluster) -> None:
    url = own.ensure().set(drivername="postgresql").render_as_string()
    with closing(psycopg.connect(url)) as stopped:
        os.kill(stopped.info.backend_pid, signal.SIGSTOP)
        kill_server(own)
        assert query(own, "SELECT 7") == 7


@pytest.mark.parametrize("time_", range(5))
def test_command_at_once_after_kill_9(
    own: Cluster, monkeypatch: pytest.MonkeyPatch, time_: int
) -> None:
    monkeypatch.setenv("SEMMAP_DATA", str(own.home))
    url = own.ensure().set(drivername="postgresql").render_as_string()
    with ExitStack() as backends:
        for _ in range(5):
            backends.enter_context(closing(psycopg.connect(url)))
        os.kill(int((own.data / "postmaster.pid").read_text().split()[0]), signal.SIGKILL)
        open_engine(migrate=False).dispose()


def test_command_line_at_once_after_kill_9(own: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMMAP_DATA", str(own.home))
    open_engine().dispose()
    os.kill(int((own.data / "postmaster.pid").read_text().split()[0]), signal.SIGKILL)
    process = python(COMMAND)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, out + err


def test_lost_socket(own: Cluster) -> None:
    query(own, "CREATE TABLE kept AS SELECT 7 AS value")
    socket_folder = own.running()
    assert socket_folder is not None
    (socket_folder / ".s.PGSQL.5432").unlink()
    assert query(own, "SELECT value FROM kept") == 7


def test_several_come_after_a_crash(own: Cluster) -> None:
    own.ensure()
    kill_server(own)
    comers = [python(ENSURE, own.home) for _ in range(3)]
    assert len({said(comer) for comer in comers}) == 1


@pytest.mark.parametrize("moment", ["new-*", "new-*/global/pg_control"])
def test_a_killed_creation_starts_again(folder: Path, moment: str) -> None:
    home = folder / "home"
    maker = python(ENSURE, home, start_new_session=True)
    while not list(home.glob(moment)):
        assert maker.poll() is None
        time.sleep(0.005)
    os.killpg(maker.pid, signal.SIGKILL)
    maker.communicate()
    assert not (home / "data").exists()
    assert query(Cluster(home), "SELECT 7") == 7
    assert not list(home.glob("new-*"))
