"""Placements against NumPy: what the triggers keep equals the product of the poses."""

from __future__ import annotations

import itertools
import threading
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine, select, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from semmap.geometry.pose import Pose
from semmap.model import Entity, GeometricModel, Object, Placement, Room, StoredMap, WorldPlacement

NAMES = itertools.count()

angles = st.floats(-3.2, 3.2)
metres = st.floats(-50, 50)
poses = st.builds(Pose.from_rpy, metres, metres, metres, angles, angles, angles)
quick = settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def new_map(session: Session) -> StoredMap:
    made = StoredMap(name=f"map{next(NAMES)}")
    session.add(made)
    session.flush()
    return made


def thing(session: Session, of: StoredMap, name: str, holder: Entity | None, pose: Pose) -> Object:
    made = Object(map=of, name=name, type="object")
    session.add(made)
    session.flush()
    session.add(Placement(entity=made, holder=holder, pose=pose))
    session.flush()
    return made


def world_poses(session: Session, of: StoredMap) -> dict[int, Pose]:
    session.expire_all()
    rows = session.execute(
        select(WorldPlacement.entity_id, WorldPlacement.pose).where(WorldPlacement.map_id == of.id)
    )
    return {row[0]: row[1] for row in rows}


@quick
@given(
    tree=st.lists(st.tuples(st.integers(0, 100), poses), min_size=1, max_size=8),
    moves=st.lists(st.tuples(st.integers(0, 100), st.integers(0, 100), poses), max_size=5),
)
def test_world_is_the_product_of_the_poses(
    engine: Engine, tree: list[tuple[int, Pose]], moves: list[tuple[int, int, Pose]]
) -> None:
    with Session(engine) as session:
        of = new_map(session)
        things: list[Object] = []
        said: list[tuple[int | None, Pose]] = []
        for number, (choice, pose) in enumerate(tree):
            holder = None if choice % (number + 1) == number else choice % (number + 1)
            above = None if holder is None else things[holder]
            things.append(thing(session, of, f"t{number}", above, pose))
            said.append((holder, pose))
        for which, into, pose in moves:
            moved = which % len(things)
            holder = None if into % (moved + 1) == moved else into % (moved + 1)
            said[moved] = (holder, pose)
            placement = session.get_one(Placement, things[moved].id)
            placement.holder_id = None if holder is None else things[holder].id
            placement.pose = pose
            session.flush()

        def matrix(i: int) -> Any:
            holder, pose = said[i]
            return pose.matrix if holder is None else matrix(holder) @ pose.matrix

        world = world_poses(session, of)
        for i, one in enumerate(things):
            np.testing.assert_allclose(world[one.id].matrix, matrix(i), atol=1e-9)


@quick
@given(pose=poses, points=st.lists(st.tuples(metres, metres, metres), min_size=4, max_size=12))
def test_box_and_footprint_are_those_of_the_turned_points(
    engine: Engine, pose: Pose, points: list[tuple[float, float, float]]
) -> None:
    with Session(engine) as session:
        of = new_map(session)
        hull = shapely.MultiPoint(points)
        model = GeometricModel(
            digest=of.name, kind="mesh", triangles=0, hull=f"SRID=0;{hull.wkt.replace('nan', '0')}"
        )
        one = Object(map=of, name="a", models=[model])
        session.add(one)
        session.flush()
        session.add(Placement(entity=one, pose=pose))
        session.flush()
        turned = pose.apply(np.array(points))
        low, high, footprint = session.execute(
            text(
                "SELECT ARRAY[ST_XMin(box), ST_YMin(box), ST_ZMin(box)], "
                "ARRAY[ST_XMax(box), ST_YMax(box), ST_ZMax(box)], ST_AsBinary(footprint) "
                "FROM world WHERE entity_id = :id"
            ),
            {"id": one.id},
        ).one()
        np.testing.assert_allclose(low, turned.min(axis=0), atol=1e-6)
        np.testing.assert_allclose(high, turned.max(axis=0), atol=1e-6)
        expected = shapely.MultiPoint(turned[:, :2]).convex_hull
        got = shapely.from_wkb(bytes(footprint))
        assert got.hausdorff_distance(expected) < 0.01
        session.rollback()


def test_a_move_touches_only_its_contents(engine: Engine) -> None:
    with Session(engine) as session:
        of = new_map(session)
        table = thing(session, of, "table", None, Pose())
        muffin = thing(session, of, "muffin", table, Pose(z=0.75))
        crumb = thing(session, of, "crumb", muffin, Pose(x=0.1))
        others = [thing(session, of, f"other{i}", None, Pose()) for i in range(5)]
        session.commit()
        versions = "SELECT entity_id, xmin::text FROM world WHERE map_id = :map"
        before = {row[0]: row[1] for row in session.execute(text(versions), {"map": of.id})}
        session.get_one(Placement, table.id).pose = Pose.planar(3, 4, 1.0)
        session.commit()
        after = {row[0]: row[1] for row in session.execute(text(versions), {"map": of.id})}
        changed = {k for k in before if before[k] != after[k]}
        assert changed == {table.id, muffin.id, crumb.id}
        assert not changed & {o.id for o in others}


def test_contents_of_a_deleted_holder_stay_where_they_are(engine: Engine) -> None:
    with Session(engine) as session:
        of = new_map(session)
        room = Room(map=of, name="room", type="room", placement=Placement(pose=Pose(x=10)))
        session.add(room)
        session.flush()
        table = thing(session, of, "table", room, Pose.planar(1, 2, 0.7))
        muffin = thing(session, of, "muffin", table, Pose.planar(0.3, 0, 0.2, z=0.75))
        before = world_poses(session, of)[muffin.id]
        session.execute(text("DELETE FROM entity WHERE id = :id"), {"id": table.id})
        session.expire_all()
        assert session.get_one(Placement, muffin.id).holder_id == room.id
        after = world_poses(session, of)[muffin.id]
        np.testing.assert_allclose(after.matrix, before.matrix, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("UPDATE placement SET holder_id = :muffin WHERE entity_id = :table", "would hold itself"),
        ("UPDATE placement SET holder_id = :table WHERE entity_id = :table", "not_in_itself"),
        ("UPDATE placement SET holder_id = :foreign WHERE entity_id = :table", "in another map"),
        ("UPDATE placement SET pose[1] = 'NaN' WHERE entity_id = :table", "seven_finite_numbers"),
        ("UPDATE placement SET pose[2] = 'Infinity' WHERE entity_id = :table", "finite_numbers"),
        ("UPDATE placement SET pose = '{1,2,3}' WHERE entity_id = :table", "seven_finite_numbers"),
        ("UPDATE placement SET pose[2] = -1.1e7 WHERE entity_id = :table", "ten_thousand_kilometr"),
        ("UPDATE placement SET pose[7] = 2 WHERE entity_id = :table", "quaternion_is_unit"),
        ("UPDATE entity SET kind = 'room' WHERE id = :table", "keeps its map and its kind"),
    ],
)
def test_bad_placements_are_refused_and_change_nothing(
    engine: Engine, change: str, says: str
) -> None:
    with Session(engine) as session:
        of = new_map(session)
        table = thing(session, of, "table", None, Pose(x=1))
        muffin = thing(session, of, "muffin", table, Pose(z=0.75))
        foreign = thing(session, new_map(session), "foreign", None, Pose())
        session.commit()
        before = world_poses(session, of)
        ids = {"table": table.id, "muffin": muffin.id, "foreign": foreign.id}
        used = {k: v for k, v in ids.items() if f":{k}" in change}
        with pytest.raises(DBAPIError, match=says):
            session.execute(text(change), used)
        session.rollback()
        assert world_poses(session, of) == before


def test_a_holder_is_locked_while_an_object_is_put_into_it(engine: Engine) -> None:
    """Two transactions at once: one moves the table, the other puts the muffin on it."""
    with Session(engine) as session:
        of = new_map(session)
        table = thing(session, of, "table", None, Pose())
        muffin = thing(session, of, "muffin", None, Pose(x=9))
        session.commit()
        ids = {"table": table.id, "muffin": muffin.id}
    url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    path = "SET search_path = semmap, public"
    with psycopg.connect(url) as mover, psycopg.connect(url) as putter:
        mover.execute(path)
        putter.execute(path)
        mover.commit()
        putter.commit()
        mover.execute(
            "UPDATE placement SET pose = '{5,0,0,0,0,0,1}' WHERE entity_id = %(table)s", ids
        )

        def put() -> None:
            putter.execute(
                "UPDATE placement SET holder_id = %(table)s, pose = '{0,0,1,0,0,0,1}' "
                "WHERE entity_id = %(muffin)s",
                ids,
            )
            putter.commit()

        second = threading.Thread(target=put)
        second.start()
        second.join(0.5)
        assert second.is_alive(), "the second transaction waits for the first"
        mover.commit()
        second.join(10)
        assert not second.is_alive()
        row = putter.execute(
            "SELECT pose[1:3] FROM world WHERE entity_id = %(muffin)s", ids
        ).fetchone()
    assert row is not None
    assert row[0] == [5.0, 0.0, 1.0]
