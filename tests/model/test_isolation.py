"""Transactions beside each other leave `world` as the placements and models say.

Each scenario runs in every order of its steps; three sessions in every second order, and in all
by `make soak`. The oracle is the tree of placements, multiplied out in NumPy, and the corners of
the models' hulls.
"""

from __future__ import annotations

import os
import random
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from psycopg.errors import (
    CheckViolation,
    DeadlockDetected,
    ForeignKeyViolation,
)
from sqlalchemy import Engine

from semmap.geometry.pose import Pose
from tests.interleaving import interleave, orders

MUG, TABLE, SHELF, ROOM, HALL = "{mug}", "{table}", "{shelf}", "{room}", "{hall}"
MOVE_TABLE = "SELECT move_to({table}, 50, 50, 0, 1)"
MOVE_ROOM = "SELECT move_to({room}, -20, 5, 1, 2)"
TAKE = "SELECT put({mug}, NULL)"
PUT_ON_SHELF = "SELECT put({mug}, {shelf})"
PUT_ON_TABLE = "SELECT put({mug}, {table})"
SLIDE = "UPDATE placement SET pose = planar_pose(3, 4) WHERE entity_id = {mug}"
TAKE_BY_SQL = (
    "UPDATE placement SET holder_id = NULL, pose = planar_pose(7, 7) WHERE entity_id = {mug}"
)
SHAPE = "INSERT INTO entity_model (entity_id, model_id) VALUES ({mug}, {cube})"
SHAPE_AGAIN = "INSERT INTO entity_model (entity_id, model_id) VALUES ({mug}, {bar})"
SHAPE_TABLE = "INSERT INTO entity_model (entity_id, model_id) VALUES ({table}, {bar})"
UNSHAPE = "DELETE FROM entity_model WHERE entity_id = {lamp}"
MOVE_LAMP = "SELECT move_to({lamp}, 9, 9, 9)"
DELETE_MUG = "DELETE FROM entity WHERE id = {mug}"
DELETE_TABLE = "DELETE FROM entity WHERE id = {table}"
LIFT = "DELETE FROM placement WHERE entity_id = {mug}"
TABLE_INTO_HALL = "SELECT put({table}, {hall})"
SHELF_ON_TABLE = "SELECT put({shelf}, {table})"
TABLE_ON_SHELF = "SELECT put({table}, {shelf})"
ADD = (
    "INSERT INTO placement (entity_id, holder_id, pose) VALUES ({cup}, {table}, planar_pose(1, 0))"
)

SCENARIOS: dict[str, list[list[str]]] = {
    "take from a table that moves": [[TAKE], [MOVE_TABLE]],
    "take by SQL from a table that moves": [[TAKE_BY_SQL], [MOVE_TABLE]],
    "put on a table that moves": [[PUT_ON_SHELF, PUT_ON_TABLE], [MOVE_TABLE]],
    "slide on a table that moves": [[SLIDE], [MOVE_TABLE, SLIDE]],
    "move a table in a room that moves": [[MOVE_TABLE], [MOVE_ROOM]],
    "move a table out of a room that moves": [[TABLE_INTO_HALL], [MOVE_ROOM]],
    "take from a table that moves to another room": [[TAKE], [TABLE_INTO_HALL, MOVE_ROOM]],
    "move it from a table that moves to one that moves": [
        [PUT_ON_SHELF],
        [MOVE_TABLE],
        ["SELECT move_to({shelf}, 8, 8, 8)"],
    ],
    "add to a table that moves": [[ADD], [MOVE_TABLE]],
    "give a shape to what moves along": [[SHAPE], [MOVE_TABLE]],
    "give a shape to what moves": [[SHAPE], [SLIDE]],
    "give two shapes": [[SHAPE], [SHAPE_AGAIN]],
    "take a shape from what moves along": [[UNSHAPE], [MOVE_LAMP], [MOVE_TABLE]],
    "give a shape to a table whose room moves": [[SHAPE_TABLE], [MOVE_ROOM], [SLIDE]],
    "delete from a table that moves": [[DELETE_MUG], [MOVE_TABLE]],
    "lift from a table that moves": [[LIFT], [MOVE_TABLE]],
    "delete the table of what is put there": [[PUT_ON_SHELF, PUT_ON_TABLE], [DELETE_TABLE]],
    "delete the table of what slides": [[SLIDE], [DELETE_TABLE]],
    "into each other": [[SHELF_ON_TABLE], [TABLE_ON_SHELF]],
    "in opposite orders": [[MOVE_TABLE, MOVE_LAMP], [MOVE_LAMP, MOVE_TABLE]],
}

MAY_FAIL = {
    "delete the table of what is put there": (CheckViolation, ForeignKeyViolation),
    "into each other": (CheckViolation, DeadlockDetected),
}
"""What may end a session: its holder is gone, it would hold itself."""


def may_fail(scenario: str) -> tuple[type[psycopg.Error], ...]:
    """Without the queue of writers, only sessions of one step are free of deadlocks."""
    several = any(len(session) > 1 for session in SCENARIOS[scenario])
    return (*MAY_FAIL.get(scenario, ()), *((DeadlockDetected,) if several else ()))


@pytest.fixture(scope="module")
def connections(module_engine: Engine) -> Iterator[list[psycopg.Connection[Any]]]:
    url = module_engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    made = [
        psycopg.connect(url, autocommit=number == 0, options="-c search_path=semmap,public")
        for number in range(4)
    ]
    made[0].execute("SET deadlock_timeout = '50ms'")
    for one in made[1:]:
        one.execute("SET deadlock_timeout = '50ms'")
        one.execute("SET semmap.queue = off")  # row locks alone keep the world right
        one.commit()
    yield made
    for one in made:
        one.close()


def corners(x: float, y: float, z: float) -> Any:
    return np.array([(i, j, k) for i in (0, x) for j in (0, y) for k in (0, z)], float)


HULLS = {"cube": corners(1, 1, 1), "bar": corners(3, 0.2, 0.1)}


def scene(watch: psycopg.Connection[Any], number: int) -> dict[str, int]:
    """A new map: a mug and a lamp on a table in a room, a shelf in it, a hall, a cup nowhere."""
    of = watch.execute("INSERT INTO map (name) VALUES (%s) RETURNING id", [f"m{number}"])
    ids = {"map": of.fetchone()[0]}  # type: ignore[index]
    for name, hull in HULLS.items():
        points = shapely.to_wkb(shapely.multipoints(hull), output_dimension=3)
        found = watch.execute(
            "INSERT INTO model (digest, kind, triangles, hull) "
            "VALUES (%s, 'mesh', 0, ST_GeomFromWKB(%s, 0)) "
            "ON CONFLICT (digest) DO UPDATE SET kind = 'mesh' RETURNING id",
            [name, points],
        )
        ids[name] = found.fetchone()[0]  # type: ignore[index]
    for name, kind, holder, pose in [
        ("room", "room", None, "planar_pose(10, 0, 0.5)"),
        ("hall", "room", None, "planar_pose(-10, 0, -1)"),
        ("table", "object", "room", "planar_pose(1, 2, 0.3)"),
        ("shelf", "object", "room", "planar_pose(4, 0, 2)"),
        ("mug", "object", "table", "planar_pose(0.2, 0.1, 1, 0.7)"),
        ("lamp", "object", "table", "planar_pose(-0.2, 0.1, 1, 0.7)"),
        ("cup", "object", None, None),
    ]:
        made = watch.execute(
            "INSERT INTO entity (map_id, kind, name) VALUES (%s, %s, %s) RETURNING id",
            [ids["map"], kind, name],
        )
        ids[name] = made.fetchone()[0]  # type: ignore[index]
        if pose is not None:
            watch.execute(
                f"INSERT INTO placement (entity_id, holder_id, pose) VALUES (%s, %s, {pose})",
                [ids[name], ids.get(holder or "")],
            )
    watch.execute("INSERT INTO entity_model VALUES (%(lamp)s, %(cube)s)", ids)
    return ids


def check_world(watch: psycopg.Connection[Any], of: int) -> None:
    placed = {
        entity: (holder, Pose(*pose).matrix)
        for entity, holder, pose in watch.execute(
            "SELECT p.entity_id, p.holder_id, p.pose FROM placement p "
            "JOIN entity e ON e.id = p.entity_id WHERE e.map_id = %s",
            [of],
        ).fetchall()
    }

    def matrix(entity: int | None) -> Any:
        if entity is None:
            return np.eye(4)
        holder, pose = placed[entity]
        return matrix(holder) @ pose

    rows = watch.execute(
        "SELECT w.entity_id, w.pose, ARRAY[ST_XMin(box), ST_YMin(box), ST_ZMin(box)], "
        "ARRAY[ST_XMax(box), ST_YMax(box), ST_ZMax(box)], (SELECT array_agg(m.digest) "
        "FROM entity_model em JOIN model m ON m.id = em.model_id WHERE em.entity_id = w.entity_id) "
        "FROM world w WHERE map_id = %s",
        [of],
    ).fetchall()
    assert {row[0] for row in rows} == {*placed}
    for entity, pose, low, high, models in rows:
        np.testing.assert_allclose(Pose(*pose).matrix, matrix(entity), atol=1e-6)
        points = np.concatenate([HULLS[m] for m in models or []] or [np.zeros((1, 3))])
        moved = points @ matrix(entity)[:3, :3].T + matrix(entity)[:3, 3]
        np.testing.assert_allclose([low, high], [moved.min(axis=0), moved.max(axis=0)], atol=1e-6)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_world_follows_the_placements_in_every_order(
    connections: list[psycopg.Connection[Any]], scenario: str
) -> None:
    watch, *others = connections
    sessions = SCENARIOS[scenario]
    every = [*orders([len(session) + 1 for session in sessions])]
    step = 1 if "SEMMAP_SOAK" in os.environ else 1 + len(every) // 20  # 90 orders of three sessions
    for number, order in enumerate(every[::step]):
        ids = scene(watch, hash((scenario, number)))
        named = [[statement.format(**ids) for statement in session] for session in sessions]
        failed = interleave(others[: len(sessions)], watch, named, order)
        assert any(error is None for error in failed), (order, failed)
        for error in failed:
            assert error is None or isinstance(error, may_fail(scenario)), (order, error)
        check_world(watch, ids["map"])
        holders = watch.execute(
            "SELECT count(*) FROM entity e JOIN placement p ON p.entity_id = e.id "
            "WHERE map_id = %s AND p.entity_id IN (SELECT holders_of(ARRAY[p.entity_id]))",
            [ids["map"]],
        ).fetchone()
        assert holders == (0,), order


def test_writers_of_several_steps_take_turns(module_engine: Engine) -> None:
    """Without the queue, half of these transactions end in deadlocks."""
    url = module_engine.url.set(drivername="postgresql").render_as_string(hide_password=False)

    def connect() -> psycopg.Connection[Any]:
        return psycopg.connect(url, options="-c search_path=semmap,public")

    with connect() as setup:
        setup.autocommit = True
        of = setup.execute("INSERT INTO map (name) VALUES ('crowd') RETURNING id").fetchone()[0]  # type: ignore[index]
        tables = [
            row[0]
            for row in setup.execute(
                "INSERT INTO entity (map_id, kind, name) SELECT %s, 'object', 'table' || i "
                "FROM generate_series(1, 5) i RETURNING id",
                [of],
            )
        ]
        setup.execute("INSERT INTO placement (entity_id) SELECT unnest(%s::bigint[])", [tables])
        mugs = [
            row[0]
            for row in setup.execute(
                "INSERT INTO entity (map_id, kind, name) SELECT %s, 'object', 'mug' || i "
                "FROM generate_series(1, 20) i RETURNING id",
                [of],
            )
        ]
        setup.execute(
            "INSERT INTO placement (entity_id, holder_id) SELECT unnest(%s::bigint[]), %s",
            [mugs, tables[0]],
        )

        def write(seed: int) -> int:
            chance = random.Random(seed)
            with connect() as own:
                for _ in range(10):
                    for _ in range(4):
                        x, y = chance.random(), chance.random()
                        moved, into = chance.choice(mugs + tables), chance.choice(tables)
                        if moved in tables or x < 0.5:
                            own.execute("SELECT move_to(%s, %s, %s, 0)", [moved, x, y])
                        else:
                            own.execute("SELECT put(%s, %s)", [moved, into])
                    own.commit()
            return 10

        with ThreadPoolExecutor(12) as pool:
            assert sum(pool.map(write, range(12))) == 120
        check_world(setup, of)


def test_who_takes_turns_keeps_nobody_waiting(module_engine: Engine) -> None:
    """Three sessions hold the queue, 0.9 s each; who waits its turn there has two in 20 s."""
    url = module_engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    end = time.monotonic() + 20

    def hold() -> None:
        with psycopg.connect(url, options="-c search_path=semmap,public") as own:
            while time.monotonic() < end:
                own.execute("SELECT pg_advisory_xact_lock(0, hashtext('semmap.placement'))")
                time.sleep(0.9)
                own.commit()

    with ThreadPoolExecutor(3) as pool:
        for _ in range(3):
            pool.submit(hold)
        time.sleep(0.5)
        turns = 0
        with psycopg.connect(url, options="-c search_path=semmap,public") as own:
            while turns < 2 and time.monotonic() < end:
                own.execute("SELECT queue_writer()")
                own.commit()
                turns += 1
        in_time = time.monotonic() < end
        end = 0.0
    assert (turns, in_time) == (2, True)
