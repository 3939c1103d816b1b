"""The files of versions and hashes fit `pyproject.toml`, and are what is installed."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "requirements"
TABLES = sorted(path.stem for path in FOLDER.glob("*.txt"))


def locked(table: str) -> list[Requirement]:
    """The lines of a file for this Python; each has a hash."""
    text = (FOLDER / f"{table}.txt").read_text()
    entries = re.findall(r"^(\S+==[^\\\n]+)((?: \\\n +--hash=sha256:[0-9a-f]{64})+)$", text, re.M)
    assert "".join(f"{line}{hashes}\n" for line, hashes in entries) == text
    found = [Requirement(line) for line, _ in entries]
    return [each for each in found if each.marker is None or each.marker.evaluate()]


@pytest.mark.parametrize("table", TABLES)
def test_what_is_locked_is_what_is_needed(table: str) -> None:
    pins = {
        canonicalize_name(each.name): each for each in [*locked("dependencies"), *locked(table)]
    }
    tables = ["ros", "ros-messages"] if table == "ros" else [table]
    run = [sys.executable, str(ROOT / "scripts" / "requirements"), *tables]
    needed = subprocess.run(run, check=True, capture_output=True, text=True).stdout.splitlines()
    assert needed
    for line in map(Requirement, needed):
        if line.marker is None or line.marker.evaluate():
            (pin,) = pins[canonicalize_name(line.name)].specifier
            assert line.specifier.contains(pin.version, prereleases=True), line


@pytest.mark.parametrize("table", ["dependencies", "test"])
def test_what_is_locked_is_installed(table: str) -> None:
    found = {each.name: version(each.name) for each in locked(table)}
    assert found == {each.name: next(iter(each.specifier)).version for each in locked(table)}
