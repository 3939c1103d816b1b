"""A mirror of the small house outlives itself, its server and its connections."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from sqlalchemy import Engine, text

from semmap.database import Cluster, open_engine
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.ingest.importer import import_file
from tests.database.conftest import made, own
from tests.database.test_crash import kill_server
from tests.oracles.region_map import check_region_map

__all__ = ["made", "own"]

SIZE = 0.05


def equal(one: VoxelMirror, other: VoxelMirror) -> bool:
    check_region_map(one.regions._native)
    return one.names == other.names and all(
        np.array_equal(one.regions.voxels(n), other.regions.voxels(n)) for n in other.names
    )


def looked(engine: Engine) -> tuple[VoxelMirror, float]:
    """A fresh mirror, and the seconds it took."""
    mirror, begin = VoxelMirror(engine, "house", SIZE), time.perf_counter()
    mirror.catch_up()
    return mirror, time.perf_counter() - begin


def test_restarts_of_everything(own: Cluster, worlds: Path) -> None:
    engine = open_engine(own.ensure())
    world = worlds / "small_house" / "worlds" / "small_house.world"
    import_file(engine, world, map_name="house")
    mirror, _ = looked(engine)
    mirror.save()
    for end in (kill_server, Cluster.stop):
        end(own)
        engine.dispose()
        engine = open_engine(own.ensure())
        number = min(mirror.names)
        with engine.begin() as connection:
            connection.execute(
                text("UPDATE placement SET pose[1] = pose[1] + 0.3 WHERE entity_id = :id"),
                {"id": number},
            )
        begin = time.perf_counter()
        mirror = VoxelMirror.resume(engine, "house", SIZE)
        assert mirror.catch_up() == {number}
        seconds = time.perf_counter() - begin
        fresh, anew = looked(engine)
        assert equal(mirror, fresh)
        assert seconds < anew
        mirror.save()
    with engine.begin() as connection:
        connection.execute(text("SELECT drop_map('house')"))
    engine.dispose()
