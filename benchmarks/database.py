"""Questions to a map of 1,000,000 objects: the statement of Figure 3, and what is near a point."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg
from sqlalchemy import Engine, text

from benchmarks.bench_map import use_bench_database
from benchmarks.timing import Row, median_seconds, print_rows
from semmap.database import open_engine
from semmap.ingest.ontology.type_store import load_tbox
from semmap.query.entity_query import find
from tests.seen import seen_by

FIGURE_3 = (Path(__file__).parent / "figure3.sql").read_text()
MILLION = (Path(__file__).parent / "million.sql").read_text()


@contextmanager
def map_of(objects: int) -> Iterator[Engine]:
    """A database of its own with a map of objects, kept for the next run; its name: `map_name`."""
    use_bench_database()
    engine = open_engine()
    name = map_name(objects)
    with engine.begin() as connection:
        there = connection.execute(text("SELECT 1 FROM map WHERE name = :n"), {"n": name}).scalar()
    if not there:
        start = time.perf_counter()
        print(f"making a map of {objects:,} objects (minutes) ...", flush=True)
        made = MILLION.format(name=name, objects=objects, rooms=objects // 100)
        with engine.begin() as connection:
            load_tbox(connection)
            connection.connection.cursor().execute(made)
        with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(text("VACUUM ANALYZE"))
        print(f"... {time.perf_counter() - start:.0f} s")
    yield engine
    engine.dispose()


def map_name(objects: int) -> str:
    """Return the name of the map of `map_of`."""
    return "million" if objects == 1_000_000 else f"objects_{objects}"


def figure_3(engine: Engine) -> list[Row]:
    """The statement as psql sends it, parsed each time, and prepared."""
    url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("SET search_path = semmap, public; SET semmap.map = 'million'")
        connection.prepare_threshold = None
        rows = connection.execute(FIGURE_3).fetchall()
        assert len(rows) == 10, rows
        sent = median_seconds(lambda: connection.execute(FIGURE_3).fetchall(), 51, 5)
        connection.execute(f"PREPARE figure3 AS {FIGURE_3}")
        prepared = median_seconds(lambda: connection.execute("EXECUTE figure3").fetchall(), 51, 12)
        nothing = median_seconds(lambda: connection.execute("SELECT 1").fetchall(), 51, 5)
    psql = subprocess.run(
        ["psql", "-X", "-q", url],
        input="SET search_path = semmap, public;\nSET semmap.map = 'million';\n\\timing on\n"
        + f"{FIGURE_3}\n" * 21,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    times = sorted(float(line.split()[1]) for line in psql.splitlines() if line.startswith("Time:"))
    by_psql = times[len(times) // 2]
    reference = f"SELECT 1: {nothing * 1e3:.2f} ms"
    return [
        Row("Figure 3 as printed, by psql", f"{by_psql:.2f} ms", reference, "< 5 ms", by_psql < 5),
        Row(
            "Figure 3 as printed, by psycopg",
            f"{sent * 1e3:.2f} ms",
            reference,
            "< 5 ms",
            sent < 5e-3,
        ),
        Row("Figure 3 prepared", f"{prepared * 1e3:.2f} ms", reference, "< 1 ms", prepared < 1e-3),
    ]


def near(engine: Engine) -> list[Row]:
    """Objects of a type with 200 subtypes within 3 m, and again after a dozen; a rare type."""
    points = [(10.0 * (i % 90) + 3.1, 10.0 * (i % 83) + 4.2, 0.7) for i in range(7, 2000, 41)]
    url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url, autocommit=True) as session:
        session.execute("SET search_path = semmap, public; SET semmap.map = 'million'")
        turn = iter(points * 20)
        found: list[int] = []
        seen = seen_by(session)

        def ask() -> None:
            found.append(len(find(seen, type="furniture", near=next(turn), within=3.0)))

        early = median_seconds(ask, 5, 0)
        late = median_seconds(ask, 101, 12)
        rare = median_seconds(lambda: find(seen, type="muffin", near=next(turn)), 21, 12)
        wide = median_seconds(
            lambda: find(seen, type="muffin", near=next(turn), within=300.0), 21, 12
        )
    assert max(found) <= 25, max(found)
    assert sum(found) > len(found)
    row = f"first five: {early * 1e3:.2f} ms; {sum(found) / len(found):.1f} rows on average"
    return [
        Row(
            "type with 200 subtypes within 3 m",
            f"{late * 1e3:.2f} ms",
            row,
            "< 2 ms, at most 25 rows",
            late < 2e-3,
        ),
        Row("ten muffins, the nearest first", f"{rare * 1e3:.1f} ms", "", "< 100 ms", rare < 0.1),
        Row("muffins within 300 m", f"{wide * 1e3:.1f} ms", "", "< 100 ms", wide < 0.1),
    ]


def main() -> None:
    """Print the table."""
    with map_of(1_000_000) as engine:
        print_rows("A map of 1,000,000 objects", figure_3(engine) + near(engine))
