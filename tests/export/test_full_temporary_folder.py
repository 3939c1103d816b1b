"""A full folder of temporary files is named, and nothing is left in it."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

import semmap
from semmap.draw.picture import Picture
from tests.export.test_full_disk import full, small_files
from tests.soak.disk import fill

__all__ = ["full"]

USERS: dict[str, Callable[[semmap.Map, Path], object]] = {
    "plan": lambda made, path: made.draw().save(path),
    "plan in 3D": lambda made, path: made.draw_3d().save(path),
    "belief": lambda made, path: made.draw(belief="mug7").save(path),
    "route": lambda made, path: made.draw(route="mug7", start="hall").save(path),
    "search": lambda made, path: made.draw(search="mug7", start="hall").save(path),
    "voxels": lambda made, path: made.draw(field="inRoom").save(path),
    "several storeys": lambda made, path: Picture.stacked(PLANS).save(path),
}
"""What makes temporary files."""

PLANS: list[Picture] = []


@pytest.fixture
def drawn(flat: semmap.Map) -> semmap.Map:
    """A map whose plans are drawn already."""
    PLANS[:] = [flat.draw(), flat.draw()]
    return flat


def is_refused(made: semmap.Map, user: str, parent: Path, path: Path) -> None:
    """Use temporary files; the error names their folder, and no file is left or changed."""
    path.write_text("former")
    before = sorted(parent.iterdir())
    with pytest.raises(OSError, match="set TMPDIR to another one") as refused:
        USERS[user](made, path)
    assert str(refused.value.filename) == str(parent)
    assert sorted(parent.iterdir()) == before
    assert path.read_text() == "former"


@pytest.mark.parametrize("user", USERS)
def test_a_full_folder_of_temporary_files_is_named(
    drawn: semmap.Map, full: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, user: str
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(full))
    filler = fill(full)
    try:
        is_refused(drawn, user, full, tmp_path / "plan.svg")
    finally:
        filler.unlink()


@pytest.mark.parametrize("user", USERS)
def test_a_temporary_file_that_cannot_be_written_is_named(
    drawn: semmap.Map, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, user: str
) -> None:
    """Also where nobody can mount a disk."""
    parent = tmp_path / "temporary"
    parent.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(parent))
    with small_files():
        is_refused(drawn, user, parent, tmp_path / "plan.svg")


@pytest.mark.usefixtures("flat")
def test_where_no_folder_takes_temporary_files_a_command_says_so(
    database: str, tmp_path: Path
) -> None:
    command = "from semmap.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", command, "--db", database, "draw", "-o", tmp_path / "plan.png"],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "TMPDIR" in done.stderr
    assert "Traceback" not in done.stderr
    assert [*tmp_path.iterdir()] == []
