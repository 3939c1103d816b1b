"""An entity that moves all day: the retention bounds what is kept, and followers stay flat."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Iterator
from typing import Any

import psycopg
import pytest
from sqlalchemy import Engine
from sqlalchemy.orm import Session

from semmap.geometry.pose import Pose
from semmap.model import Agent, Placement
from semmap.query.change_feed import ChangeFeed
from tests.growth.moves import RETENTION, expired_changes, gaps, move, versions
from tests.model.test_placement import new_map, thing

MOVES = 300
EVERY, KEEP = 0.02, 0.2


@pytest.fixture(scope="module")
def scene(module_engine: Engine) -> Iterator[tuple[psycopg.Connection[Any], dict[str, int]]]:
    """A session with a short retention, and the ids of a robot and of a mug."""
    with Session(module_engine) as session:
        of = new_map(session)
        mug = thing(session, of, "mug", None, Pose(x=1))
        robot = Agent(map=of, name="robot", placement=Placement())
        session.add(robot)
        session.commit()
        ids = {"agent": robot.id, "object": mug.id}
    url = module_engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url, autocommit=True, options="-c search_path=semmap,public") as own:
        own.execute(RETENTION, {"every": EVERY, "keep": KEEP})
        yield own, ids


@pytest.mark.parametrize("kind", ["agent", "object"])
def test_the_retention_bounds_what_moves_leave(
    scene: tuple[psycopg.Connection[Any], dict[str, int]], kind: str
) -> None:
    own, ids = scene
    for _ in move(own, ids[kind], MOVES):
        # one that ends within the retention, one that is extended, one for the start
        assert versions(own, ids[kind]) <= KEEP / EVERY + 3
    assert gaps(own) == 0


def test_changes_are_deleted_by_moves(
    scene: tuple[psycopg.Connection[Any], dict[str, int]],
) -> None:
    own, ids = scene
    own.execute("SELECT setval('change_id_seq', nextval('change_id_seq') / 1000 * 1000 + 999)")
    for _ in move(own, ids["object"], 100):
        pass
    assert expired_changes(own) <= 300  # of 700


def test_a_follower_keeps_nothing_of_what_it_saw(
    module_engine: Engine, scene: tuple[psycopg.Connection[Any], dict[str, int]]
) -> None:
    own, ids = scene
    feed = ChangeFeed(module_engine)
    seen = 0

    def look() -> None:
        nonlocal seen
        with feed.look() as look:
            seen += look.changed == {ids["object"]}
        feed.take_in(look)

    taken = []
    look()
    tracemalloc.start()
    for _ in move(own, ids["object"], 400):
        for _ in range(5):
            look()
        gc.collect()
        taken.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert seen == len(taken)
    assert taken[-1] - taken[0] < 20_000  # bytes
