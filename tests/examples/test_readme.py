"""The README's commands, run as it has them, say what it says that they do."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
SEMMAP = Path(sys.executable).parent / "semmap"
MEASURED = re.compile(r"\d+\.\d s$")
"""How long it took: the one thing in them that differs from run to run."""


def sessions() -> Iterator[tuple[str, list[str]]]:
    """The commands after ``$ `` in the README's indented blocks, with the lines they print."""
    command, printed = "", []
    for line in README.read_text().splitlines():
        if not line.startswith("    "):
            if command:
                yield command, printed
            command, printed = "", []
        elif line.startswith("    $ "):
            if command:
                yield command, printed
            command, printed = line[6:], []
        elif command and _goes_on(command):
            command += "\n" + line[4:]
        elif command:
            printed.append(line[4:].rstrip())


def _goes_on(command: str) -> bool:
    try:
        shlex.split(command)
    except ValueError:
        return True
    return command.endswith("\\")


def test_the_readme_shows_what_its_commands_print(
    make_database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SEMMAP_DB", make_database().render_as_string(hide_password=False))
    monkeypatch.setenv("COLUMNS", "140")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    ran = []
    for command, printed in sessions():
        program, *rest = command.split(" ", 1)
        assert program == ".venv/bin/semmap"
        done = subprocess.run(
            ["bash", "-c", f"{shlex.quote(str(SEMMAP))} {rest[0]}"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            env=os.environ,
        )
        assert done.returncode == 0, done.stderr
        lines = [line.rstrip() for line in done.stdout.splitlines() if line.strip()]
        assert [MEASURED.sub("", line) for line in lines[: len(printed)]] == [
            MEASURED.sub("", line) for line in printed
        ], command
        ran.append(rest[0].split()[0])
    assert ran == ["import", "sql", "route", "grid", "costmap", "plan"]
