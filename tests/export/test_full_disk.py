"""A file that cannot be written is named, and the former one is kept."""

from __future__ import annotations

import errno
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import semmap
from semmap.export.formats import FORMATS
from tests.soak.disk import fill, small_disk

WRITERS: dict[str, Callable[[semmap.Map, Path], object]] = {
    **{f"map{ending}": lambda made, path: made.export(path) for ending in FORMATS},
    "facts.ttl": lambda made, path: made.export_rdf(path),
    "mapping.ttl": lambda made, path: made.export_r2rml(path),
    "doors.dot": lambda made, path: made.write_topology(path),
    "doors.json": lambda made, path: made.write_topology(path),
    "ways.geojson": lambda made, path: made.write_topology(path, format="nav2"),
    "plan.png": lambda made, path: made.draw().save(path),
    "plan.svg": lambda made, path: made.draw().save(path),
    "plan.qgz": lambda made, path: made.write_qgis_project(path),
}
"""What writes a file of this name."""


@pytest.fixture(scope="module")
def full() -> Iterator[Path]:
    with small_disk(2) as disk:
        if disk is None:
            pytest.skip("only root can mount a small disk")
        yield disk


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_named_and_keeps_the_former_file(
    flat: semmap.Map, full: Path, name: str
) -> None:
    path = full / name
    path.write_text("former")
    filler = fill(full)
    try:
        with pytest.raises(OSError, match="No space left") as refused:
            WRITERS[name](flat, path)
        assert refused.value.errno == errno.ENOSPC
        assert str(refused.value.filename) == str(path)
        filler.unlink()
        assert path.read_text() == "former"
        assert [each.name for each in full.iterdir()] == [name]
    finally:
        filler.unlink(missing_ok=True)
        path.unlink()


@contextmanager
def small_files(most: int = 100) -> Iterator[None]:
    """Let this process write no file beyond so many bytes, as a quota does."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("name", WRITERS)
def test_a_write_that_fails_keeps_the_former_file(
    flat: semmap.Map, tmp_path: Path, name: str
) -> None:
    """Also where nobody can mount a disk; libraries say it by errors of their own."""
    path = tmp_path / name
    path.write_text("former")
    with small_files(), pytest.raises(Exception, match=r"too large|EFBIG|sqlite|disk"):
        WRITERS[name](flat, path)
    assert path.read_text() == "former"
    assert [each.name for each in tmp_path.iterdir()] == [name]
