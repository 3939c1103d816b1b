"""Pages that a power cut left in part are whole again after the next start."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from pathlib import Path
from random import Random

import psycopg
import pytest

from semmap.database import Cluster, DatabaseError
from semmap.database.leftovers import servers_in
from tests.database.conftest import query
from tests.soak.power import copy_pages, cut, damaged, log_position, small_buffers

ROWS = 20_000


def cut_power(cluster: Cluster, folder: Path) -> int:
    """Cut the power while rows change again after a checkpoint; returns how many pages are torn."""
    url = cluster.ensure().set(drivername="postgresql").render_as_string(hide_password=False)
    with suppress(psycopg.OperationalError), psycopg.connect(url, autocommit=True) as connection:
        connection.execute("CREATE TABLE kept (id int PRIMARY KEY, value int)")
        connection.execute(f"INSERT INTO kept SELECT i, 0 FROM generate_series(1, {ROWS}) i")
        connection.execute("CHECKPOINT")
        copy_pages(cluster.data, folder)
        connection.execute("UPDATE kept SET value = 1")
        flushed, _ = log_position(connection)
        with connection.transaction():
            connection.execute("UPDATE kept SET value = 2")
            time.sleep(0.2)  # the server writes pages
            os.kill(int((cluster.data / "postmaster.pid").read_text().split()[0]), signal.SIGKILL)
            while servers_in(cluster.data):
                time.sleep(0.01)
    return cut(cluster.data, folder, flushed, Random(7))


def test_committed_rows_outlive_torn_pages(folder: Path, tmp_path: Path) -> None:
    cluster = Cluster(folder / "cut")
    small_buffers(cluster)
    assert cut_power(cluster, tmp_path) > 100
    assert query(cluster, "SELECT count(*) FROM kept WHERE value = 1") == ROWS
    assert damaged(cluster) == []


def test_the_judge_sees_torn_pages(folder: Path, tmp_path: Path) -> None:
    """Without whole pages in the log, the same cut is not undone."""
    cluster = Cluster(folder / "cut")
    small_buffers(cluster, "full_page_writes = off\n")
    assert cut_power(cluster, tmp_path) > 100
    with pytest.raises((DatabaseError, psycopg.Error)):
        query(cluster, "SELECT count(*) FROM kept WHERE value = 1")
