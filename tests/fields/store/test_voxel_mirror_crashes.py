"""A mirror, its server and connections killed at random moments: it ends equal to a fresh one."""

from __future__ import annotations

import contextlib
import random
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError

from semmap.database import Cluster, open_engine
from semmap.fields.store import field_store
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.ingest.importer import import_file
from tests.database.conftest import python
from tests.database.test_crash import kill_server
from tests.fields.store.test_voxel_mirror import SIZE, boxes, change, number, same, scene
from tests.seen import seen_by
from tests.waiting import wait_until

__all__ = ["scene"]

TERMINATE = """
SELECT pg_terminate_backend(pid) FROM pg_stat_activity
WHERE pid <> pg_backend_pid() AND datname = current_database()
"""
FOLLOW = """
import sys, threading, time
from semmap.database import DatabaseError, open_engine
from semmap.database.notifications import SERVER_AWAY
from semmap.fields.store.voxel_mirror import VoxelMirror

while True:
    try:
        mirror = VoxelMirror.resume(open_engine(sys.argv[1]), "scene", float(sys.argv[2]))
        break
    except (DatabaseError, *SERVER_AWAY):  # the server is away
        time.sleep(0.05)
mirror.follow(threading.Event(), save_every=0.0)
"""


def resumed(engine: Engine) -> VoxelMirror:
    return VoxelMirror.resume(engine, "scene", SIZE)


def test_a_mirror_continues_from_its_state(scene: Engine) -> None:
    mirror = resumed(scene)
    assert mirror.catch_up() == set(mirror.names), "without a saved state, it reads the whole map"
    assert mirror.save() == 1
    again = resumed(scene)
    assert again.names == mirror.names
    points = np.random.default_rng(1).uniform(-1, 6, (2000, 3))
    numbers = mirror.regions.set_numbers_at(points)
    assert np.array_equal(again.regions.set_numbers_at(points), numbers)
    assert again.regions.sets(numbers) == mirror.regions.sets(numbers)
    assert again.catch_up() == set(), "nothing changed"
    change(scene, "SELECT move_to(entity_id('b'), 3.0, 1.0, 0.2, 0.3)")
    gone = number(scene, "d")
    change(scene, "DELETE FROM entity WHERE name = 'd'")
    moved = {number(scene, "b"), number(scene, "c")}
    later = resumed(scene)
    assert gone in later.regions
    assert later.catch_up() == moved | {gone}
    assert same(later, scene)
    change(scene, "UPDATE entity SET name = 'bee' WHERE name = 'b'")
    assert again.catch_up() == moved | {gone}
    assert again.names[number(scene, "bee")] == "bee"
    assert same(again, scene)


def test_a_save_writes_what_changed(scene: Engine) -> None:
    mirror = resumed(scene)
    mirror.catch_up()
    mirror.save()
    change(scene, "SELECT move_to(entity_id('d'), 5.1, 5.0, 0.2, 0.0)")
    mirror.catch_up()
    assert mirror.save() == 2
    with scene.connect() as connection:
        name, walls = connection.execute(text("SELECT name FROM field ORDER BY name")).scalars()
        assert walls == f"walls {SIZE} m"
        (version,) = field_store.versions(seen_by(connection), name)
        cubes = connection.execute(text("SELECT count(*) FROM field_block")).scalar_one()
    assert version.version == 2
    assert 1 <= version.blocks < cubes, "former versions made way"


def test_states_that_cannot_be_continued(scene: Engine, tmp_path: Path) -> None:
    with pytest.raises(LookupError, match="catch_up first"):
        resumed(scene).save()
    mirror = resumed(scene)
    mirror.catch_up()
    mirror.save()
    everything = set(mirror.names)
    assert VoxelMirror.resume(scene, "scene", SIZE / 2).catch_up() == everything, "of other voxels"
    assert resumed(scene).catch_up() == set()

    def spoilt(statement: str) -> bool:
        """Return whether a mirror reads the whole map after a statement; save the state again."""
        change(scene, statement)
        anew = resumed(scene)
        begun = anew.catch_up() == everything and same(anew, scene)
        mirror.save()
        return begun

    assert spoilt("""UPDATE field_version SET state = jsonb_set(state, '{by,0}', '"0.0"')""")
    assert spoilt("""UPDATE field_version SET state = jsonb_set(state, '{by,1}', '"77"')""")
    assert spoilt("UPDATE field_version SET legend = '{}'")
    assert spoilt("UPDATE field_version SET state = NULL")
    assert resumed(scene).catch_up() == set()
    # from before the history that is kept
    change(scene, "SELECT move_to(entity_id('a'), 1.0, 1.0, 0.2, 0.0)")
    change(scene, "DELETE FROM change")
    anew = resumed(scene)
    assert anew.catch_up() == everything
    assert same(anew, scene)
    # another map of that name
    mirror.catch_up()
    mirror.save()
    change(scene, "SELECT drop_map('scene')")
    import_file(scene, boxes(tmp_path, z=(1, 1, 0.2)), map_name="scene")
    anew = resumed(scene)
    assert set(anew.names) == set()
    assert len(anew.catch_up()) == 1
    assert same(anew, scene)


def test_transaction_numbers_that_a_crash_repeats(own: Cluster, tmp_path: Path) -> None:
    """The number of a transaction undone before a crash is used again; a mirror reads both."""
    with (own.home / "local.conf").open("a") as file:
        file.write("wal_writer_delay = 10s\nautovacuum = off\nbgwriter_delay = 10s\n")
    first = engine = open_engine(own.ensure())
    try:
        import_file(engine, boxes(tmp_path, a=(0, 0, 0.2)), map_name="scene")
        mirror = VoxelMirror(engine, "scene", SIZE)
        mirror.catch_up()
        undone = []
        for _ in range(3):
            with engine.connect() as connection:
                connection.execute(text("SELECT move_to(entity_id('a'), 9.0, 0.0, 0.2, 0.0)"))
                undone.append(connection.execute(text("SELECT txid_current()")).scalar_one())
                connection.rollback()
        mirror.catch_up()
        kill_server(own)
        first.dispose()
        engine = open_engine(own.ensure())
        mirror._engine = engine
        change(engine, "SELECT move_to(entity_id('a'), 2.0, 0.0, 0.2, 0.0)")
        assert mirror.catch_up() == {number(engine, "a")}
        assert same(mirror, engine)
        change(engine, "SELECT drop_map('scene')")
    finally:
        engine.dispose()
        first.dispose()  # the mirror's feed reads by it


class Writer(threading.Thread):
    """Move entities, undo some moves, and continue when the connection breaks."""

    def __init__(self, engine: Engine) -> None:
        super().__init__()
        self.engine, self.stop, self.moves = engine, threading.Event(), 0

    def run(self) -> None:
        dice = random.Random(3)
        while not self.stop.wait(dice.uniform(0, 0.02)):
            x, y, z = (dice.uniform(-3, 3) for _ in range(3))
            statement = f"SELECT move_to(entity_id('{dice.choice('abcd')}'), {x}, {y}, {z}, 0.0)"
            try:
                with self.engine.connect() as connection:
                    connection.execute(text(statement))
                    if dice.random() < 0.8:
                        connection.commit()
                self.moves += 1
            except DBAPIError:
                pass


# SQLAlchemy drops, unclosed, a connection whose server dies while it is being set up.
@pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <function BaseConnection.__del__"
    ":pytest.PytestUnraisableExceptionWarning"
)
def test_crashes_at_random_moments(own: Cluster, tmp_path: Path) -> None:
    """A mirror in another process that saves, one that does not, and crashes of both."""
    dice = random.Random(7)
    url = own.ensure()
    name = url.render_as_string(hide_password=False)
    engine = open_engine(url)
    at = {"a": (0, 0, 0.2), "b": (2, 0, 0.2), "c": (2, 0, 0.6), "d": (5, 5, 0.2)}
    import_file(engine, boxes(tmp_path, **at), map_name="scene")
    here, stop, writer = VoxelMirror(engine, "scene", SIZE), threading.Event(), Writer(engine)
    follower = threading.Thread(target=here.follow, args=(stop,), kwargs={"patience": 0.05})
    mirrors = [python(FOLLOW, name, SIZE)]
    kills = ["mirror"] * 3 + ["connections"] * 4 + ["server"] * 2
    dice.shuffle(kills)
    writer.start()
    follower.start()
    try:
        for what in kills:
            time.sleep(dice.uniform(0.02, 0.6))
            if what == "mirror":
                mirrors[-1].kill()
                mirrors.append(python(FOLLOW, name, SIZE))
            elif what == "server":
                kill_server(own)
                own.ensure()
            else:
                with contextlib.suppress(DBAPIError):
                    change(engine, TERMINATE)
        wait_until(lambda: state_saved(engine), 60)
    finally:
        for event, thread in ((writer.stop, writer), (stop, follower)):
            event.set()
            thread.join(20)
        for mirror in mirrors:
            mirror.kill()
        printed = [mirror.communicate()[1] for mirror in mirrors]
    assert not writer.is_alive()
    assert not follower.is_alive()
    assert {mirror.returncode for mirror in mirrors} == {-signal.SIGKILL}, "".join(printed)
    assert writer.moves > 20
    here.catch_up()
    assert same(here, engine)
    last = resumed(engine)
    assert last.names, "it continues from the saved state"
    last.catch_up()
    assert same(last, engine)
    change(engine, "SELECT drop_map('scene')")
    engine.dispose()


def state_saved(engine: Engine) -> bool:
    with contextlib.suppress(DBAPIError), engine.connect() as connection:
        return bool(connection.execute(text("SELECT count(*) FROM field_version")).scalar())
    return False
