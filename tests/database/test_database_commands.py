"""`semmap db` as a user calls it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from semmap import cli
from semmap.database import Cluster, DatabaseError, revisions

ROOT = Path(__file__).parents[2]


def out(*arguments: str, **environment: str) -> str:
    """What `semmap ARGUMENTS` prints, with the given variables in its environment."""
    done = CliRunner().invoke(cli.app, arguments, env=environment)
    if done.exception is not None:
        raise done.exception
    return done.stdout


def process(*arguments: str) -> subprocess.CompletedProcess[str]:
    """`semmap ARGUMENTS` in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", "from semmap.cli import main; main()", *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )


def test_life_of_the_embedded_database(own: Cluster) -> None:
    home = str(own.home)
    assert "not running" in out("db", "status", SEMMAP_DATA=home)
    assert own.running() is None
    assert f"{home}: ready after" in out("db", "start", SEMMAP_DATA=home)
    status = out("db", "status", SEMMAP_DATA=home)
    assert f"schema at revision {revisions.newest()}\n" in status
    assert "PostGIS 3." in status
    assert "data checksums on" in status
    assert out("db", "url", SEMMAP_DATA=home).startswith("postgresql://semmap@/semmap?host=")
    assert "stopped" in out("db", "stop", SEMMAP_DATA=home)
    assert own.running() is None
    assert "was not running" in out("db", "stop", SEMMAP_DATA=home)


def test_status_makes_nothing(folder: Path) -> None:
    assert "not made yet" in out("db", "status", SEMMAP_DATA=str(folder / "none"))
    assert not (folder / "none").exists()


def test_down_and_up(database: str) -> None:
    down = out("--db", database, "db", "downgrade", "base")
    assert down == "schema at revision none\n"
    behind = out("db", "status", SEMMAP_DB=database)
    assert f"the newest is {revisions.newest()}: semmap db upgrade" in behind
    up = out("db", "upgrade", SEMMAP_DB=database)
    assert up == f"schema at revision {revisions.newest()}\n"


def test_drop_asks_for_confirmation(database: str) -> None:
    with pytest.raises(SystemExit):
        out("db", "drop", SEMMAP_DB=database)
    assert f"revision {revisions.newest()}" in out("db", "status", SEMMAP_DB=database)
    out("db", "drop", "--yes", SEMMAP_DB=database)
    assert "revision none" in out("db", "status", SEMMAP_DB=database)


@pytest.mark.skipif(shutil.which("psql") is None, reason="psql is not installed")
def test_psql_sees_the_map(database: str) -> None:
    asked = "SELECT count(*) FROM map; SHOW TimeZone"
    assert process("--db", database, "db", "psql", "-tAc", asked).stdout.split() == ["0", "UTC"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--db", "mysql://x/y", "db", "status"), "needs PostgreSQL"),
        (("db", "downgrade", "nonsense"), "cannot be downgraded"),
    ],
)
def test_errors(database: str, arguments: tuple[str, ...], said: str) -> None:
    with pytest.raises(DatabaseError, match=said):
        out(*arguments, SEMMAP_DB=database)


def test_error_is_a_line_and_exit_code_2() -> None:
    done = process("--db", "postgresql://user:secret@127.0.0.1:1/x", "db", "url", "--nonsense")
    assert done.returncode == 2
    done = process("--db", "postgresql://user:secret@127.0.0.1:1/x", "db", "upgrade")
    assert done.returncode == 2
    assert "Is the server running" in done.stderr
    assert "Traceback" not in done.stderr
    assert "secret" not in done.stderr
