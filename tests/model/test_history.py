"""Where things were, how much of that is kept, and who hears of a change."""

from __future__ import annotations

import json
import time
from datetime import UTC, datetime, timedelta
from typing import Any

import psycopg
import pytest
from sqlalchemy import Engine, func, select, text
from sqlalchemy.orm import Session

from semmap.geometry.pose import Pose
from semmap.model import Agent, EntityHistory, Object, Placement, PlacementHistory, StoredMap
from tests.model.test_placement import new_map, thing


def now(session: Session) -> datetime:
    moment: datetime = session.execute(text("SELECT clock_timestamp()")).scalar_one()
    return moment


def pose_at(session: Session, entity_id: int, moment: datetime) -> list[float] | None:
    found: list[float] | None = session.execute(
        text("SELECT pose_at(:id, :at)"), {"id": entity_id, "at": moment}
    ).scalar_one()
    return found


def test_where_was_the_mug(engine: Engine) -> None:
    with Session(engine) as session:
        of = new_map(session)
        table = thing(session, of, "table", None, Pose(x=1))
        mug_id = thing(session, of, "mug1", table, Pose(z=0.75)).id
        session.commit()
        long_ago = datetime(2000, 1, 1, tzinfo=UTC)
        first = now(session)
        session.commit()
        session.get_one(Placement, table.id).pose = Pose(x=2)
        session.commit()
        second = now(session)
        session.commit()
        placement = session.get_one(Placement, mug_id)
        placement.holder_id, placement.pose = None, Pose(x=7, y=7)
        session.commit()
        third = now(session)
        assert pose_at(session, mug_id, long_ago) is None
        assert pose_at(session, mug_id, first) == [1, 0, 0.75, 0, 0, 0, 1]
        assert pose_at(session, mug_id, second) == [2, 0, 0.75, 0, 0, 0, 1]
        assert pose_at(session, mug_id, third) == [7, 7, 0, 0, 0, 0, 1]
        session.execute(text("DELETE FROM entity WHERE id = :id"), {"id": mug_id})
        session.commit()
        assert pose_at(session, mug_id, third) == [7, 7, 0, 0, 0, 0, 1]
        assert pose_at(session, mug_id, now(session)) is None


def test_versions_follow_each_other_without_gap(engine: Engine) -> None:
    with Session(engine) as session:
        of = new_map(session)
        mug = thing(session, of, "mug", None, Pose())
        session.commit()
        for i in range(1, 6):
            session.get_one(Placement, mug.id).pose = Pose(x=i)
            session.commit()
        spans = list(
            session.scalars(
                select(PlacementHistory.during)
                .where(PlacementHistory.entity_id == mug.id)
                .order_by(func.lower(PlacementHistory.during))
            )
        )
        assert len(spans) == 5
        ends = [s.upper for s in spans]
        starts = [s.lower for s in spans[1:]] + [session.get_one(Placement, mug.id).since]
        assert ends == starts


def test_poses_of_a_robot_at_20_hz_are_thinned(engine: Engine) -> None:
    """400 poses in 20 s leave about one version a second, and each moment still has an answer."""
    with Session(engine) as session:
        of = new_map(session)
        robot = Agent(map=of, name="robot")
        mug = Object(map=of, name="mug")
        session.add_all([robot, mug])
        session.flush()
        session.add_all([Placement(entity=robot), Placement(entity=mug)])
        session.commit()
        start = now(session)
        session.commit()
        began = time.monotonic()
        # Time is passed by shifting what there is into the past, not by waiting.
        for i in range(1, 101):
            session.execute(
                text(
                    "ALTER TABLE placement DISABLE TRIGGER USER; "
                    f"UPDATE placement SET since = since - interval '50 ms' "
                    f"WHERE entity_id IN ({robot.id}, {mug.id}); "
                    "ALTER TABLE placement ENABLE TRIGGER USER; "
                    "UPDATE placement_history SET during = "
                    "tstzrange(lower(during) - interval '50 ms', upper(during) - interval '50 ms') "
                    f"WHERE entity_id IN ({robot.id}, {mug.id}); "
                    f"UPDATE placement SET pose[1] = {i} WHERE entity_id IN ({robot.id}, {mug.id})"
                )
            )
            session.commit()
        rows = session.execute(
            select(PlacementHistory.entity_id, func.count())
            .where(PlacementHistory.entity_id.in_([robot.id, mug.id]))
            .group_by(PlacementHistory.entity_id)
        )
        kept = {row[0]: row[1] for row in rows}
        assert kept[mug.id] == 100
        # A second of what passed, be it shifted or waited for on a busy machine, keeps one.
        assert 4 <= kept[robot.id] <= 7 + time.monotonic() - began
        for back in (0.5, 1.7, 3.2, 4.4):
            assert pose_at(session, robot.id, start - timedelta(seconds=back - 0.2)) is not None


def test_old_poses_of_agents_are_pruned(engine: Engine) -> None:
    with Session(engine) as session:
        of = new_map(session)
        robot = Agent(map=of, name="robot", placement=Placement())
        mug = thing(session, of, "mug", None, Pose())
        session.add(robot)
        session.commit()
        for entity in (robot, mug):
            session.get_one(Placement, entity.id).pose = Pose(x=1)
        session.commit()
        session.execute(
            text(
                "UPDATE placement_history SET during = "
                "tstzrange(lower(during) - interval '31 days', upper(during) - interval '31 days') "
                "WHERE entity_id IN (:a, :b)"
            ),
            {"a": robot.id, "b": mug.id},
        )
        assert session.execute(text("SELECT prune_history()")).scalar_one() == 1
        left = session.scalars(select(PlacementHistory.entity_id)).all()
        assert mug.id in left
        assert robot.id not in left


def test_a_move_prunes_history_older_than_the_retention(engine: Engine) -> None:
    with Session(engine) as session:
        of = new_map(session)
        mug = thing(session, of, "mug", None, Pose())
        for x in (1, 2, 3):
            session.get_one(Placement, mug.id).pose = Pose(x=x)
            mug.label = f"{x}"
            session.commit()
        for table, back in (("placement_history", 366), ("entity_history", 366)):
            session.execute(
                text(
                    f"UPDATE {table} SET during = tstzrange(lower(during) - make_interval(days => "
                    ":back), upper(during) - make_interval(days => :back)) WHERE entity_id = :id "
                    f"AND upper(during) < (SELECT max(upper(during)) FROM {table})"
                ),
                {"back": back, "id": mug.id},
            )
        session.get_one(Placement, mug.id).pose = Pose(x=4)
        mug.label = "4"
        session.commit()
        for history in (PlacementHistory, EntityHistory):
            spans = session.scalars(select(history.during).where(history.entity_id == mug.id)).all()
            assert len(spans) == 2, history
            assert all(span.lower > now(session) - timedelta(days=1) for span in spans)


def test_history_of_deleted_entities_is_pruned_after_the_retention(engine: Engine) -> None:
    with Session(engine) as session:
        of = new_map(session)
        mug, lamp = (thing(session, of, name, None, Pose()) for name in ("mug", "lamp"))
        session.get_one(Placement, mug.id).pose = Pose(x=1)
        session.commit()
        session.delete(mug)
        session.delete(lamp)
        session.commit()
        for table in ("placement_history", "entity_history"):
            session.execute(
                text(
                    f"UPDATE {table} SET during = tstzrange('2001-01-01', '2001-01-02') "
                    "WHERE entity_id = :id"
                ),
                {"id": mug.id},
            )
        session.execute(text("SELECT apply_retention()"))
        for history in (PlacementHistory, EntityHistory):
            assert {*session.scalars(select(history.entity_id))} == {lamp.id}, history


def test_after_the_clock_was_set_back_the_latest_pose_is_the_one_now(engine: Engine) -> None:
    with Session(engine) as session:
        of = new_map(session)
        mug = Object(map=of, name="mug", type="object")
        session.add(mug)
        session.flush()
        tomorrow = now(session) + timedelta(days=1)  # as the clock was before
        session.add(Placement(entity=mug, pose=Pose(x=1), since=tomorrow))
        session.commit()
        session.get_one(Placement, mug.id).pose = Pose(x=2)
        session.commit()
        session.get_one(Placement, mug.id).pose = Pose(x=3)
        session.commit()
        latest = session.execute(text("SELECT (pose_at(:id, now()))[1]"), {"id": mug.id})
        assert latest.scalar_one() == 3
        assert pose_at(session, mug.id, now(session) - timedelta(days=1)) is None


@pytest.fixture
def listener(engine: Engine) -> Any:
    url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("LISTEN semmap")
        yield connection


def heard(listener: psycopg.Connection[Any], timeout: float = 0.5) -> list[dict[str, Any]]:
    return [json.loads(n.payload) for n in listener.notifies(timeout=timeout)]


def test_each_transaction_announces_once(engine: Engine, listener: psycopg.Connection[Any]) -> None:
    with Session(engine) as session:
        of = new_map(session)
        table = thing(session, of, "table", None, Pose())
        mug = thing(session, of, "mug", table, Pose())
        session.get_one(Placement, table.id).pose = Pose(x=1)
        session.commit()
        (said,) = heard(listener)
        assert said["maps"] == [of.name]
        assert said["added"] == [table.id, mug.id]
        assert said["moved"] == [table.id, mug.id]

        session.get_one(Placement, table.id).pose = Pose(x=2)
        session.rollback()
        assert heard(listener, 0.2) == []

        session.execute(
            text(
                "INSERT INTO entity (map_id, kind, name) "
                "SELECT :map, 'object', 'o' || i FROM generate_series(1, 20000) i"
            ),
            {"map": of.id},
        )
        session.commit()
        (said,) = heard(listener)
        assert said["added"] == 20000


def test_a_cursor_does_not_skip_late_commits(engine: Engine) -> None:
    with Session(engine) as early, Session(engine) as late, Session(engine) as reader:
        of = new_map(late)
        late.commit()
        map_id = of.id

        def add(session: Session, name: str) -> int:
            made = Object(map=session.get_one(StoredMap, map_id), name=name)
            session.add(made)
            session.flush()
            return made.id

        def since(cursor: str) -> tuple[set[int], str]:
            rows = reader.execute(
                text("SELECT entities, cursor FROM changes_since(:c)"), {"c": cursor}
            ).all()
            reader.commit()
            return {i for row in rows for i in row[0]}, rows[-1][1] if rows else cursor

        cursor = reader.execute(text("SELECT change_cursor()")).scalar_one()
        reader.commit()
        a = add(early, "a")
        b = add(late, "b")
        late.commit()
        seen, cursor = since(cursor)
        assert seen == {b}
        early.commit()
        seen, cursor = since(cursor)
        assert seen == {a}
        assert since(cursor)[0] == set()
