"""Clusters of a test's own, and what runs as another user."""

from __future__ import annotations

import json
import os
import pwd
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine, text

from semmap.database import Cluster
from semmap.database.account import server_account
from tests.cluster_folder import cluster_folder

ROOT = Path(__file__).parents[2]

OWN_SERVER = "fsync = off\nshared_buffers = 32MB\ndynamic_shared_memory_type = mmap\n"


@pytest.fixture
def folder() -> Iterator[Path]:
    """An empty folder that all users may enter; what runs on clusters below it is stopped."""
    with cluster_folder(Path("/tmp")) as folder:
        yield folder


@pytest.fixture(scope="session")
def made() -> Iterator[Cluster]:
    """A cluster that was made, and does not run."""
    with cluster_folder(Path("/tmp")) as folder:
        cluster = Cluster(folder / "made")
        cluster.ensure()
        cluster.stop()
        yield cluster


@pytest.fixture
def own(made: Cluster) -> Iterator[Cluster]:
    """A cluster that a test may do with as it likes; it does not run yet."""
    # what a killed process wrote is the kernel's, which keeps it whether told to sync or not
    (made.home / "local.conf").write_text(OWN_SERVER)
    yield made
    (made.home / "local.conf").unlink(missing_ok=True)
    query(made, "DROP TABLE IF EXISTS kept")
    made.stop()


@pytest.fixture
def move_to(own: Cluster) -> Iterator[Callable[[str], Cluster]]:
    """Gives the cluster of `own` in a folder of another name."""
    moved = []

    def move(name: str) -> Cluster:
        moved.append(Cluster(own.home.rename(own.home.with_name(name))))
        return moved[0]

    yield move
    socket_folder = moved[0].running()
    moved[0].stop()
    if socket_folder is not None and socket_folder.parent != moved[0].home:
        socket_folder.rmdir()
    moved[0].home.rename(own.home)


def query(cluster: Cluster, statement: str) -> Any:
    """What a statement says first, on the running or started cluster."""
    engine = create_engine(cluster.ensure())
    try:
        with engine.begin() as connection:
            result = connection.execute(text(statement))
            return result.scalar() if result.returns_rows else None
    finally:
        engine.dispose()


def as_owner(cluster: Cluster) -> dict[str, Any]:
    """What lets a process run as the user that the server runs as."""
    owner = server_account(cluster.data)
    return {} if owner.is_caller else {"user": owner.uid, "group": owner.gid, "extra_groups": []}


def python(code: str, *arguments: object, **options: Any) -> subprocess.Popen[str]:
    """A Python process of its own that runs `code`."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **options.pop("env", {})}
    return subprocess.Popen(
        [*options.pop("prefix", []), sys.executable, "-c", code, *map(str, arguments)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def said(process: subprocess.Popen[str]) -> Any:
    """What such a process printed, read as JSON; it must end well."""
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    return json.loads(out)


DAC_READ_SEARCH = 2
"""The capability's bit, as linux/capability.h has it."""


def become(name: str) -> list[str]:
    """The start of a command that runs as another user.

    It keeps the right to read, so that it finds a Python that lies in a closed folder; a container
    that has no such right to give has its Python in an open one.
    """
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        pytest.skip("only root can become another user, by setpriv")
    user = pwd.getpwnam(name)
    status = Path("/proc/self/status").read_text()
    bound = int(status.partition("CapBnd:")[2].split()[0], 16)
    reading = ["--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search"]
    return [
        "setpriv",
        f"--reuid={user.pw_uid}",
        f"--regid={user.pw_gid}",
        "--clear-groups",
        *(reading if bound & 1 << DAC_READ_SEARCH else []),
    ]
