"""TIAGo's master costmap from the database, and after a chair has moved: OFFICE-40x25 at 5 cm."""

from __future__ import annotations

import importlib.metadata
import time
from functools import partial
from pathlib import Path

import numpy as np
import psycopg
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from sqlalchemy import Connection, text

from benchmarks import office
from benchmarks.bench_map import use_bench_database
from benchmarks.timing import Row, medians_in_turn, print_rows
from navgrid.costmap import Costmap
from navgrid.grid import Grid
from navgrid.readers.fields import read_mirror
from semmap.database import open_engine
from semmap.database.maps import pick_map
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.geometry.mesh import join
from semmap.geometry.pose import Pose
from semmap.ingest.ontology.type_store import load_tbox
from semmap.ingest.store.world_store import store_world
from semmap.ingest.world import Entry, Shape, World
from semmap.query.change_feed import changed_since
from semmap.query.map_handle import MapHandle
from semmap.query.storey_reader import read_entities, read_scene
from semmap.robot import LinkGroup, load_robot, robot_parts
from tests.seen import cursor, seen_by

__all__ = ["main"]

GRID = Grid((0.0, 0.0), 0.05, (500, 800))
EDGE = 0.285
PARTS = {"base": ("base",), "arm": ("arm",), "pole": ("torso", "head")}
"""Three parts of TIAGo, of those that `semmap.robot` finds."""


def tiago() -> Path:
    """The URDF of TIAGo, where example-robot-data is installed."""
    files = importlib.metadata.files("example-robot-data") or []
    return Path(str(next(f.locate() for f in files if str(f).endswith("robots/tiago.urdf"))))


def store_office(connection: psycopg.Connection[object], map_id: int) -> None:
    """The office as entities: each desk, chair, ... an object of its own, the walls one."""
    solids, meshes = office.solids(), office.meshes(EDGE)
    walls = [
        m
        for m, s in zip(meshes, solids, strict=True)
        if (isinstance(s, office.Box) and s.high[2] - s.low[2] > 2) or m is meshes[1]
    ]
    entries = [Entry("walls", "object", "wall", shapes=[Shape("mesh", join(walls))])]
    groups: dict[tuple[float, float], list[int]] = {}
    for number, solid in enumerate(solids):
        if any(meshes[number] is wall for wall in walls):
            continue
        key = solid.centre if isinstance(solid, office.Box) and solid.yaw else (number, 0)
        groups.setdefault((float(key[0]), float(key[1])), []).append(number)
    for name, numbers in enumerate(groups.values()):
        mesh = join([meshes[n] for n in numbers])
        type_ = "floor" if numbers == [0] else "chair" if len(numbers) == 6 else "table"
        middle = mesh.vertices.mean(axis=0)
        pose = Pose(float(middle[0]), float(middle[1]))
        entries.append(
            Entry(
                f"{type_}{name}",
                "object",
                type_,
                pose=pose,
                shapes=[Shape("mesh", mesh.moved(pose.inverse()))],
            )
        )
    store_world(connection, map_id, World("office40", Path("office40"), entries), "bench")


def main() -> None:
    """Print the table."""
    use_bench_database()
    engine = open_engine()
    with engine.begin() as connection:
        load_tbox(connection)
        connection.execute(text("SELECT drop_map(name) FROM map WHERE name = 'office40'"))
        made = connection.execute(text("INSERT INTO map (name) VALUES ('office40') RETURNING id"))
        driver = connection.connection.driver_connection
        assert driver is not None
        store_office(driver, made.scalar_one())
    robot = load_robot(tiago())
    found = {p.name: p.links for p in robot_parts(robot, {})}
    groups = [LinkGroup(n, tuple(li for f in fs for li in found[f])) for n, fs in PARTS.items()]
    parts = robot_parts(robot, {}, groups)
    with engine.connect() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'office40', false)"))
        rows = [*measure(connection, parts), *measure_voxels(connection, parts)]
        connection.execute(text("SELECT drop_map('office40')"))
        connection.commit()
    print_rows("TIAGo's master costmap of OFFICE-40x25, 800 x 500 cells, three parts", rows)


def measure(connection: Connection, parts: list) -> list[Row]:  # type: ignore[type-arg]
    """The rows of the table; the rest of a run is in its parts' sum."""
    splits = []
    for _ in range(9):
        start = time.perf_counter()
        scene = read_scene(seen_by(connection), "office40")
        fetched = time.perf_counter()
        costmap = Costmap(scene, parts, GRID)
        done = time.perf_counter()
        splits.append(
            (fetched - start, costmap.seconds["slabs"], costmap.seconds["inflation"], done - start)
        )
    fetch, slabs, inflation, whole = np.median(splits, axis=0)
    count = sum(len(t.triangles) for t in scene.entities)
    chair = next(t for t in scene.entities if "chair" in t.types)
    updates = []
    since = cursor(seen_by(connection))
    connection.commit()
    for turn in range(15):
        connection.execute(
            text(
                "SELECT move_to(:id, p.pose[1] + :by, p.pose[2], p.pose[3], 0.0) "
                "FROM placement p WHERE p.entity_id = :id"
            ),
            {"id": chair.id, "by": 0.3 if turn % 2 else -0.3},
        )
        connection.commit()
        start = time.perf_counter()
        ids, since = changed_since(seen_by(connection), since), cursor(seen_by(connection))
        assert ids is not None  # the history reaches back
        entities = read_entities(seen_by(connection), ids)
        costmap.update(entities, set(ids) - {t.id for t in entities})
        updates.append(time.perf_counter() - start)
    fresh = Costmap(read_scene(seen_by(connection), "office40"), parts, GRID)
    same = bool((fresh.master == costmap.master).all())
    moved = float(np.median(updates))
    return [
        Row(
            f"database to master, {count:,} triangles",
            f"{1e3 * whole:.0f} ms",
            f"fetch {1e3 * fetch:.0f}, slabs {1e3 * slabs:.0f}, inflation {1e3 * inflation:.0f} ms",
            "< 150 ms",
            whole < 0.15,
        ),
        Row(
            "after a moved chair",
            f"{1e3 * moved:.1f} ms",
            f"equal to a fresh costmap: {'yes' if same else 'NO'}",
            "< 10 ms",
            moved < 0.01 and same,
        ),
    ]


if __name__ == "__main__":
    main()


def measure_voxels(connection: Connection, parts: list) -> list[Row]:  # type: ignore[type-arg]
    """The rows of costmaps from voxels, beside those from meshes."""
    start = time.perf_counter()
    VoxelMirror(connection.engine, "office40").catch_up()
    mirrored = time.perf_counter() - start
    start = time.perf_counter()
    voxels = read_mirror(MapHandle(connection.engine, pick_map(connection)))
    loaded = time.perf_counter() - start
    scenes = [
        read_scene(seen_by(connection), "office40"),
        read_scene(seen_by(connection), "office40", voxels=voxels),
    ]
    meshes, own = medians_in_turn(
        *(partial(Costmap, scene, parts, GRID) for scene in scenes), times=5
    )
    a, b = (Costmap(scene, parts, GRID) for scene in scenes)
    apart = max(
        far_apart(
            np.any([cells[number] for cells in a.occupied.values()], axis=0),
            np.any([cells[number] for cells in b.occupied.values()], axis=0),
        )
        for number in range(len(parts))
    )
    count = sum(len(each) for each in voxels.values())
    return [
        Row(
            f"costmap from {count:,} voxels",
            f"{1e3 * own:.0f} ms",
            f"from meshes {1e3 * meshes:.0f} ms; cells more than a voxel apart: {apart:.2%}",
            "< 1 % apart",
            apart < 0.01,
        ),
        Row(
            "voxels that contain all meshes",
            f"{1e3 * loaded:.0f} ms",
            f"a mirror of the same meshes {1e3 * mirrored:.0f} ms",
            "at most 2x",
            loaded <= 2 * mirrored,
        ),
    ]


def far_apart(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    """The share of occupied cells that have none of the other within a cell.

    At the ends of a part's interval, a voxel can be in it where its mesh is not.
    """
    around = np.ones((3, 3))
    alone = (a & ~binary_dilation(b, around)) | (b & ~binary_dilation(a, around))
    return float(alone.sum() / max(1, (a | b).sum()))
