"""Commands that do not import leave a schema as it is, and name the command that helps."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from sqlalchemy import Engine, text

from semmap.database import DatabaseError
from semmap.database.revisions import newest
from tests.command_line import semmap
from tests.next_revision import next_revision

READING = [
    "maps",
    "types",
    "ls",
    "check",
    "changes",
    "show mug",
    "sql SELECT",
    "drop flat --yes",
    "use flat",
    "grid --output nowhere",
    "route a b",
    "plan on(a,b)",
    "topology",
    "missions",
    "robot ls",
    "regions ls",
    "fields ls",
]


@pytest.mark.parametrize("command", READING)
def test_database_without_schema_stays_empty(engine: Engine, database: str, command: str) -> None:
    with engine.begin() as connection:
        connection.execute(text("DROP SCHEMA semmap CASCADE; DROP TABLE public.semmap_version"))
    with pytest.raises(DatabaseError, match="the database has no semmap schema: semmap db upgrade"):
        semmap(database, *command.split())
    with engine.connect() as connection:
        assert connection.scalar(text("SELECT to_regnamespace('semmap')")) is None


@pytest.mark.parametrize("command", ["maps", "ls", "check", "route a b"])
def test_former_schema_stays(engine: Engine, database: str, command: str) -> None:
    former = newest()
    expected = rf"at revision {former}, .*: run semmap db upgrade"
    with next_revision(), pytest.raises(DatabaseError, match=expected):
        semmap(database, *command.split())
    with engine.connect() as connection:
        version = connection.scalar(text("SELECT version_num FROM public.semmap_version"))
    assert version == former


def test_reading_makes_no_embedded_database(tmp_path: Path) -> None:
    call = "import sys; sys.argv[0] = 'semmap'; from semmap.cli import main; main()"
    environment = {k: v for k, v in os.environ.items() if k != "SEMMAP_DB"}
    done = subprocess.run(
        [sys.executable, "-c", call, "ls"],
        env={**environment, "SEMMAP_DATA": str(tmp_path / "none")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert "semmap import FILE makes it" in done.stderr
    assert not (tmp_path / "none").exists()
