"""The mirror compared with a new one: entities move, messages are lost, connections break."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from sqlalchemy import Engine, text

import semmap
from semmap.fields.store.reader import read_zones
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.ingest.importer import import_file
from tests.oracles.region_map import check_region_map
from tests.seen import seen_by
from tests.waiting import wait_until

SIZE = 0.1


def boxes(folder: Path, **at: tuple[float, float, float]) -> Path:
    """An SDF world of cubes of 0.4 m."""
    models = "".join(
        f"<model name='{name}'><pose>{x} {y} {z} 0 0 0</pose><link name='l'><visual name='v'>"
        "<geometry><box><size>0.4 0.4 0.4</size></box></geometry></visual></link></model>"
        for name, (x, y, z) in at.items()
    )
    path = folder / "boxes.sdf"
    path.write_text(f"<sdf version='1.7'><world name='boxes'>{models}</world></sdf>")
    return path


@pytest.fixture
def scene(engine: Engine, tmp_path: Path) -> Engine:
    """A database with four cubes, of which c stands on b."""
    world = boxes(tmp_path, a=(0, 0, 0.2), b=(2, 0, 0.2), c=(2, 0, 0.6), d=(5, 5, 0.2))
    import_file(engine, world, map_name="scene")
    return engine


def number(engine: Engine, name: str) -> int:
    with engine.connect() as connection:
        return int(connection.execute(text(f"SELECT entity_id('{name}')")).scalar_one())


def change(engine: Engine, statement: str) -> None:
    with engine.begin() as connection:
        connection.execute(text(statement))


def same(mirror: VoxelMirror, engine: Engine) -> bool:
    """Return whether a mirror equals a new one, voxel by voxel."""
    fresh = VoxelMirror(engine, "scene", SIZE)
    fresh.catch_up()
    check_region_map(mirror.regions._native)
    return mirror.names == fresh.names and all(
        np.array_equal(np.unique(one.voxels(n), axis=0), np.unique(other.voxels(n), axis=0))
        for one, other in [(mirror.regions, fresh.regions), (mirror.walls, fresh.walls)]
        for n in other.entities()
    )


def test_entities_at_points(scene: Engine) -> None:
    mirror = VoxelMirror(scene, voxel_size=SIZE)
    assert mirror.catch_up() == set(mirror.names)
    a = number(scene, "a")
    assert mirror.regions.entities_at([(0.05, 0.05, 0.15), (1.0, 0.0, 0.0)]) == [{a}, set()]
    assert len(mirror.regions.voxels(a)) == 4**3
    assert sorted(mirror.names.values()) == ["a", "b", "c", "d"]
    assert mirror.catch_up() == set(), "nothing changed"


def test_only_changed_entities_are_voxelised_again(scene: Engine) -> None:
    mirror = VoxelMirror(scene, "scene", SIZE)
    mirror.catch_up()
    change(scene, "SELECT move_to(entity_id('b'), 3.0, 1.0, 0.2, 0.3)")
    assert mirror.catch_up() == {number(scene, "b"), number(scene, "c")}, "with the entity on it"
    assert same(mirror, scene)
    gone = number(scene, "d")
    change(scene, "DELETE FROM entity WHERE name = 'd'")
    assert mirror.catch_up() == {gone}
    assert gone not in mirror.regions
    assert same(mirror, scene)


def test_an_import_is_followed(scene: Engine, tmp_path: Path) -> None:
    mirror = VoxelMirror(scene, "scene", SIZE)
    mirror.catch_up()
    more = tmp_path / "more"
    more.mkdir()
    import_file(scene, boxes(more, e=(0, 3, 0.2)), map_name="scene", source="more")
    assert number(scene, "e") in mirror.catch_up()
    assert same(mirror, scene)


def test_other_maps_are_ignored(scene: Engine, tmp_path: Path) -> None:
    mirror = VoxelMirror(scene, "scene", SIZE)
    mirror.catch_up()
    other = tmp_path / "other"
    other.mkdir()
    import_file(scene, boxes(other, z=(0, 0, 0.2)), map_name="elsewhere")
    assert mirror.catch_up() == set()
    assert "z" not in mirror.names.values()


def test_any_order_of_moves_and_reads(scene: Engine) -> None:
    mirror = VoxelMirror(scene, "scene", SIZE)
    random = np.random.default_rng(4)
    for _ in range(25):
        name = random.choice(["a", "b", "c", "d"])
        x, y, z, yaw = random.uniform((-3, -3, 0, -3), (3, 3, 2, 3))
        change(scene, f"SELECT move_to(entity_id('{name}'), {x}, {y}, {z}, {yaw})")
        if random.random() < 0.5:
            mirror.catch_up()
    mirror.catch_up()
    assert same(mirror, scene)


def test_a_late_commit_is_not_missed(scene: Engine) -> None:
    mirror = VoxelMirror(scene, "scene", SIZE)
    mirror.catch_up()
    with scene.connect() as late:
        late.execute(text("SELECT move_to(entity_id('a'), 1.0, 1.0, 0.2, 0.0)"))
        change(scene, "SELECT move_to(entity_id('d'), 4.0, 4.0, 0.2, 0.0)")
        assert mirror.catch_up() == {number(scene, "d")}
        late.commit()
    assert mirror.catch_up() == {number(scene, "a")}
    assert same(mirror, scene)


def test_the_mirror_survives_broken_connections(scene: Engine) -> None:
    mirror = VoxelMirror(scene, "scene", SIZE)
    stop, heard = threading.Event(), list[set[int]]()
    thread = threading.Thread(target=mirror.follow, args=(stop, heard.append), daemon=True)
    thread.start()
    try:
        wait_until(lambda: len(heard) == 1)
        a = number(scene, "a")
        change(scene, "SELECT move_to(entity_id('a'), 1.5, 1.0, 0.2, 0.0)")
        wait_until(lambda: heard[-1] == {a})
        for turn in range(3):
            before = len(heard)
            change(
                scene,
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                "WHERE pid <> pg_backend_pid() AND datname = current_database()",
            )
            change(scene, f"SELECT move_to(entity_id('a'), {turn}, 2.0, 0.2, 0.1)")
            wait_until(lambda before=before: len(heard) > before)  # type: ignore[misc]
    finally:
        stop.set()
        thread.join(10)
    assert not thread.is_alive()
    assert same(mirror, scene)


def test_no_map(engine: Engine) -> None:
    with pytest.raises(LookupError, match="there is no map"):
        VoxelMirror(engine).catch_up()


def test_zones_are_followed(engine: Engine) -> None:
    """A room of the office and a region that is drawn, moved and taken away."""
    office = Path(__file__).parents[3] / "examples" / "office" / "office_rooms.geojson"
    import_file(engine, office, map_name="scene")
    mirror = VoxelMirror(engine, "scene", SIZE)
    mirror.catch_up()
    before = voxels_by_name(mirror)
    with engine.connect() as connection:
        zones = {z.name: z for z in read_zones(seen_by(connection)).values()}
    assert set(before) == set(zones)
    assert zones["office4"].kind == "room"
    assert mirror.roles[number(engine, "office4")] == "room"
    for name in ("office4", "home"):
        zone, points = zones[name], (before[name] + 0.5) * SIZE
        assert shapely.contains_xy(zone.outline, points[:, 0], points[:, 1]).all()
        volume = zone.outline.area * (zone.high - zone.low)
        assert len(points) * SIZE**3 == pytest.approx(volume, rel=0.1)
    home = number(engine, "home")
    change(engine, f"UPDATE placement SET pose = pose WHERE entity_id = {home}")
    assert mirror.catch_up() == set(), "unchanged zones are not voxelised again"
    change(engine, f"UPDATE placement SET pose[1] = pose[1] + 0.5 WHERE entity_id = {home}")
    assert mirror.catch_up() == {home}
    now = voxels_by_name(mirror)
    assert [name for name in now if not np.array_equal(now[name], before[name])] == ["home"]
    np.testing.assert_allclose(
        (now["home"].mean(axis=0) - before["home"].mean(axis=0)) * SIZE, (0.5, 0, 0), atol=1e-9
    )
    mirror.save()
    resumed = VoxelMirror.resume(engine, "scene", SIZE)
    assert resumed.catch_up() == set(), "zones are part of the state"
    assert resumed.roles == mirror.roles
    change(engine, f"DELETE FROM entity WHERE id = {home}")
    mirror.catch_up()
    assert "home" not in voxels_by_name(mirror)


def test_regions_begin_and_end_with_time(scene: Engine) -> None:
    """Nothing is written then: the next change of anything shows it."""
    with semmap.connect(scene.url.render_as_string(hide_password=False)) as db:
        here = db.map("scene")
        for name, x in (("early", 0.0), ("late", 3.0), ("always", 6.0)):
            here.add_region(name, [(x, 0), (x + 1, 0), (x + 1, 1), (x, 1)], floor=0, ceiling=1)
        until = "UPDATE region SET valid = tstzrange({}) WHERE entity_id = entity_id('{}')"
        soon = "now() + interval '0.6 s'"
        change(scene, until.format(f"NULL, {soon}", "early"))
        change(scene, until.format(f"{soon}, NULL", "late"))
    mirror = VoxelMirror(scene, "scene", SIZE)
    mirror.catch_up()
    assert {"early", "always"} <= {*mirror.names.values()}
    assert "late" not in mirror.names.values()
    time.sleep(0.7)
    change(scene, "SELECT move_to(entity_id('a'), 8.0, 8.0, 0.2, 0.0)")
    mirror.catch_up()
    assert "early" not in mirror.names.values()
    assert same(mirror, scene)


def voxels_by_name(mirror: VoxelMirror) -> dict[str, Any]:
    found = {name: mirror.regions.voxels(n) for n, name in mirror.names.items()}
    return {name: voxels[np.lexsort(voxels.T)] for name, voxels in found.items()}
