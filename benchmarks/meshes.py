"""Meshes in and out of the database, beside a plain binary COPY of the same bytes."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import psycopg
from sqlalchemy import text

from benchmarks.bench_map import use_bench_database
from benchmarks.timing import Row, median_seconds, medians_in_turn, print_rows
from semmap.database import open_engine
from semmap.geometry.mesh import Mesh
from semmap.geometry.tin import encode_chunks
from semmap.ingest.importer import import_file
from semmap.ingest.ontology.type_store import load_tbox
from semmap.ingest.store.world_store import store_world
from semmap.ingest.world import Entry, Shape, World
from semmap.query.meshes import model_triangles


def terrain(side: int) -> Mesh:
    """A rolling surface of ``2 * (side - 1)**2`` triangles over 40 x 40 m."""
    x, y = np.meshgrid(np.linspace(0, 40, side), np.linspace(0, 40, side))
    vertices = np.column_stack([x.ravel(), y.ravel(), (np.sin(x) * np.cos(y)).ravel()])
    i = np.arange(side * side).reshape(side, side)
    a, b, c, d = (q.ravel() for q in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return Mesh(vertices, faces.astype(np.int32))


def main() -> None:
    """Print the table."""
    use_bench_database()
    engine = open_engine()
    mesh = terrain(708)
    triangles = len(mesh.faces)
    url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    rows: list[Row] = []
    with psycopg.connect(url, options="-c search_path=semmap,public") as connection:
        patches = list(encode_chunks(mesh.triangles))
        connection.execute("CREATE TEMP TABLE plain (number int, geom bytea)")
        connection.execute("ALTER TABLE plain ALTER COLUMN geom SET STORAGE EXTENDED")

        def plain_in() -> None:
            connection.execute("TRUNCATE plain")
            with connection.cursor().copy("COPY plain FROM STDIN (FORMAT BINARY)") as copy:
                copy.set_types(["int4", "bytea"])
                for row in enumerate(patches):
                    copy.write_row(row)
            connection.commit()

        seconds_in = []
        for run in range(5):
            connection.execute("SELECT drop_map(name) FROM map WHERE name = 'bench'")
            made = connection.execute("INSERT INTO map (name) VALUES ('bench') RETURNING id")
            row = made.fetchone()
            assert row is not None
            connection.commit()
            shifted = Mesh(mesh.vertices + run * 1e-3, mesh.faces)
            world = World(
                "bench", Path("bench"), [Entry("a", "object", shapes=[Shape("mesh", shifted)])]
            )
            start = time.perf_counter()
            store_world(connection, row[0], world, "bench")
            connection.commit()
            seconds_in.append(time.perf_counter() - start)
        ours_in = sorted(seconds_in)[2]
        copy_in = median_seconds(plain_in, 5)
        rows.append(
            Row(
                f"{triangles:,} triangles in memory to committed rows",
                f"{triangles / ours_in / 1e6:.2f} M/s",
                f"COPY of the same bytes: {triangles / copy_in / 1e6:.2f} M/s",
                ">= 0.5 M/s",
                triangles / ours_in >= 5e5,
            )
        )

        row = connection.execute("SELECT max(id) FROM model").fetchone()
        assert row is not None
        model_id = row[0]

        def plain_out() -> None:
            select = f"SELECT geom FROM chunk WHERE model_id = {model_id} ORDER BY number"
            with connection.cursor().copy(f"COPY ({select}) TO STDOUT (FORMAT BINARY)") as copy:
                for _ in copy:
                    pass

        got = model_triangles(connection, model_id)
        assert got.shape == (triangles, 3, 3)
        ours, plain = medians_in_turn(lambda: model_triangles(connection, model_id), plain_out)
        rows.append(
            Row(
                f"{triangles:,} triangles to arrays",
                f"{ours:.3f} s",
                f"binary COPY of the same bytes: {plain:.3f} s ({ours / plain:.2f}x)",
                "<= 2x",
                ours <= 2 * plain,
            )
        )
        connection.execute("SELECT drop_map('bench')")
        connection.commit()

    worlds = Path(os.environ.get("SEMMAP_WORLDS", "../shared/worlds"))
    house = worlds / "small_house" / "worlds" / "small_house.world"
    if house.is_file():
        with engine.begin() as sa:
            load_tbox(sa)  # once a database, not once a world
            sa.execute(text("SELECT drop_map(name) FROM map WHERE name = 'bench_house'"))
        start = time.perf_counter()
        summary = import_file(engine, house, map_name="bench_house")
        took = time.perf_counter() - start
        rows.append(
            Row(
                "small_house, file to map",
                f"{took:.1f} s",
                f"{summary.added} entities, {summary.triangles:,} triangles",
                "< 15 s",
                took < 15,
            )
        )
        with engine.begin() as sa:
            sa.execute(text("SELECT drop_map('bench_house')"))
    print_rows("Meshes in and out", rows)
