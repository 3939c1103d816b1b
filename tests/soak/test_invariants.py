"""The checks of `make soak` find what is wrong, and nothing in a sound map."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import psycopg
from sqlalchemy import Engine

import semmap
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.ingest.importer import import_file
from tests.forged import forge
from tests.soak.actors import COUNTED, IMPORTED
from tests.soak.invariants import (
    signature,
    url_of,
    violations,
    wrong_cursors,
    wrong_follower,
    wrong_mirror,
    wrong_service,
    wrong_statements,
)
from tests.soak.kills import boxes, is_running
from tests.soak.statements import UPDATE

DAMAGE = (
    "UPDATE world SET pose[1] = 77 WHERE entity_id = {box}",
    "DELETE FROM object_type WHERE id = {box}",
    "UPDATE placement_history SET during = tstzrange(lower(during), upper(during) + '1 second')",
    "DELETE FROM change WHERE what = 'added'",
)
WRONG = (
    "world poses that do not follow",
    "supertypes that do not follow",
    "former placements that do not end",
    "entities without the change that added them",
    "step 2 was committed, 1 is there",
    "is no version of its file",
)


def test_the_checks_find_what_is_wrong(module_engine: Engine, tmp_path: Path) -> None:
    import_file(module_engine, boxes(tmp_path / "boxes.sdf", range(3)), map_name=IMPORTED)
    with module_engine.begin() as connection:
        versions = {signature(connection, IMPORTED)}
        box = connection.exec_driver_sql(
            "UPDATE entity SET properties = jsonb_build_object(%s::text, 1) "
            "WHERE name = 'box1' RETURNING id",
            (COUNTED,),
        ).scalar_one()
        connection.exec_driver_sql("SELECT move_to(%s, 1.0, 3.0, 0)", (box,))
        connection.exec_driver_sql("SELECT move_to(%s, 1.0001, 3.0, 0)", (box,))
    mirror = VoxelMirror(module_engine, IMPORTED)
    mirror.catch_up()
    mirror.save()
    file, poller = tmp_path / f"writer-{box}", tmp_path / "poller"
    file.write_text("1\n2")  # the second line is not there as a whole
    url = module_engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url, options="-c search_path=semmap,public") as own:
        row = own.execute("SELECT array_agg(id), change_cursor() FROM change").fetchone()
        assert row is not None
        ids, cursor = row
        poller.write_text(json.dumps({"ids": ids, "cursor": cursor}) + "\n")
        assert wrong_cursors(own, poller) == []
        poller.write_text(json.dumps({"ids": [*ids[2:], ids[2], -1], "cursor": cursor}) + "\n")
        skipped, twice, unknown = wrong_cursors(own, poller)
    assert "skipped 2 changes" in skipped
    assert "1 changes twice" in twice
    assert "1 changes that were not committed" in unknown
    assert violations(module_engine, tmp_path, IMPORTED, versions) == []
    assert wrong_mirror(module_engine, IMPORTED) == []
    assert wrong_service(module_engine, IMPORTED, tmp_path / "service") == []
    (tmp_path / "service").write_text("2026-01-31T12:00:00+00:00\n")
    (lost,) = wrong_service(module_engine, IMPORTED, tmp_path / "service")
    assert lost == "the look of 2026-01-31T12:00:00+00:00 was kept, the newest one is None"

    file.write_text("1\n2\n")
    with module_engine.begin() as connection:
        forge(connection.exec_driver_sql, DAMAGE[0].format(box=box))
    assert wrong_mirror(module_engine, IMPORTED) == ["the mirror of box1 is old"]
    with module_engine.begin() as connection:
        for statement in DAMAGE[1:]:
            forge(connection.exec_driver_sql, statement.format(box=box))
    found = "\n".join(violations(module_engine, tmp_path, IMPORTED, versions))
    for what in WRONG:
        assert what in found
    with module_engine.begin() as connection:  # what was damaged on purpose is no finding
        connection.exec_driver_sql("DELETE FROM map WHERE name = %s", (IMPORTED,))


def test_the_checks_find_lost_statements_and_a_late_follower(
    module_engine: Engine, tmp_path: Path
) -> None:
    import_file(module_engine, boxes(tmp_path / "boxes.sdf", range(3)), map_name="stated")
    follower = tmp_path / "follower"
    with semmap.connect(url_of(module_engine)) as db:
        stated = db.map("stated")
        for name, number, acknowledged in (("box0", 3, 3), ("box1", 4, 5), ("box2", 6, 6)):
            stated.update(UPDATE.format(name, number))
            (tmp_path / f"stated-{name}").write_text(f"{acknowledged}\n")
        follower.write_text(json.dumps({"count": 3, "seen": [["box0", 3]]}))
        assert wrong_follower(module_engine, "stated", follower) == []
        (lost,) = wrong_statements(module_engine, "stated", tmp_path)
        assert lost == "box1: 5 was stated, [4] is there"
        stated.update("INSERT DATA { :box2 <urn:soak:count> 5 }")
        assert len(wrong_statements(module_engine, "stated", tmp_path)) == 2
        assert len(wrong_follower(module_engine, "stated", follower, 0.2)) == 1
        follower.write_text(json.dumps({"count": 4, "seen": [["box0", 2]]}))
        assert len(wrong_follower(module_engine, "stated", follower, 0.2)) == 1
        db.drop_map("stated")


def test_a_process_runs_until_each_of_its_threads_is_stopped() -> None:
    threads = (
        "import threading, time; "
        "[threading.Thread(target=time.sleep, args=(60,)).start() for _ in 'ab']; "
        "print(flush=True)"
    )
    with subprocess.Popen([sys.executable, "-c", threads], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert is_running(process)
        process.send_signal(signal.SIGSTOP)
        while is_running(process):
            time.sleep(0.01)
        process.send_signal(signal.SIGCONT)
        while not is_running(process):
            time.sleep(0.01)
        process.kill()
    assert not is_running(process)
