"""The database of the benchmarks, which is kept between runs, and maps that are made for one."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import semmap

__all__ = ["fresh_map", "use_bench_database"]


def use_bench_database(part: str = "") -> None:
    """Let this process use the embedded database in the folder of SEMMAP_BENCH, or a part of it."""
    folder = Path(os.environ.get("SEMMAP_BENCH", Path(tempfile.gettempdir()) / "semmap-bench"))
    os.environ["SEMMAP_DATA"] = str(folder / part)


@contextmanager
def fresh_map(
    name: str, make: Callable[[semmap.Database], semmap.Map]
) -> Iterator[tuple[semmap.Database, semmap.Map]]:
    """Make a map in the database of the benchmarks, and drop it in the end."""
    use_bench_database()
    with semmap.connect(migrate=True) as db:
        if name in db.maps:
            db.drop_map(name)
        made = make(db)
        try:
            yield db, made
        finally:
            db.drop_map(name)
