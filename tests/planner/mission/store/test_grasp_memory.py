"""Pickups use stored or generated grasps, and their outcomes are learned."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import pytest
from sqlalchemy import Connection, text

import semmap
from planner.mission.behaviours import Outcome
from planner.mission.command import Command
from planner.mission.store.grasp_memory import GraspMemory
from semmap.database.maps import see_map
from semmap.geometry.pose import Pose
from semmap.manipulation.retrieval import DEFAULT_GRIPPER, register_gripper
from tests.conftest import MakeDatabase
from tests.seen import seen_by

MUG = Command("pickup", ("mug", "table"))
PUT = Command("place", ("mug", "table"))


@pytest.fixture(scope="module")
def flat(make_database: MakeDatabase) -> Iterator[semmap.Map]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        made = db.create_map("flat")
        made.add_room("room", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.7)
        made.add_object("table", type="table", size=(1.6, 0.8, 0.75), pose=(1.5, 1.5, 0))
        made.add_object("mug", type="mug", size=(0.07, 0.07, 0.1), pose=(1.5, 1.5, 0.75))
        made.add_object("board", type="shelf", size=(2, 1, 0.02), pose=(1.5, 1.5, 1.5))
        made.add_agent("tiago", type="robot", size=(0.5, 0.5, 1.2), pose=(3, 1, 0))
        made.add_object("ghost", type="mug", pose=(1.8, 1.5, 0.75))
        register_gripper(db.session, DEFAULT_GRIPPER)
        yield made


@pytest.fixture
def connection(flat: semmap.Map) -> Iterator[Connection]:
    """The flat, for one test: what the test changes is undone."""
    with flat.database.engine.connect() as connection:
        see_map(connection, "flat")
        yield connection
        connection.rollback()


@pytest.fixture
def robot(connection: Connection) -> int:
    return connection.execute(text("SELECT entity_id('tiago')")).scalar_one()


def tasks(connection: Connection) -> list[tuple[object, ...]]:
    statement = "SELECT outcome, message, action_id FROM task ORDER BY id"
    return [tuple(row) for row in connection.execute(text(statement))]


def take(connection: Connection, robot: int) -> None:
    """The robot holds the mug, turned."""
    grip = [0.3, 0.0, 0.8, 0.0, 0.0, 1.0, 0.0]
    connection.execute(text(HOLD), {"robot": robot, "grip": grip})


HOLD = """
UPDATE placement SET holder_id = :robot, relation = 'in', pose = :grip
WHERE entity_id = entity_id('mug')
"""


def tried(connection: Connection) -> dict[int, tuple[float, float]]:
    statement = "SELECT id, attempts, successes FROM action WHERE attempts > 0"
    return {id_: (a, s) for id_, a, s in connection.execute(text(statement))}


def begin(memory: GraspMemory, connection: Connection, robot: int, *more: object) -> int:
    """The action with which a pickup or place begins, which is not refused."""
    choice = memory.begin(seen_by(connection), robot, *more)  # type: ignore[arg-type]
    assert choice.refusal is None
    assert choice.action is not None
    return choice.action


def test_a_failed_grasp_is_not_tried_again_before_better_ones(
    connection: Connection, robot: int
) -> None:
    memory = GraspMemory()
    first = begin(memory, connection, robot, MUG)
    assert tasks(connection) == [("running", None, first)]
    memory.end(connection, robot, MUG, Outcome("missed", "it slipped"))
    second = begin(memory, connection, robot, MUG)
    memory.end(connection, robot, MUG, Outcome())
    assert tasks(connection) == [("error", "it slipped", first), ("completed", None, second)]
    assert tried(connection) == {first: (1, 0), second: (1, 1)}
    assert begin(memory, connection, robot, MUG) == second


def test_grasps_that_failed_come_last_although_a_simulation_teaches_nothing(
    connection: Connection, robot: int
) -> None:
    memory = GraspMemory(simulated=True)
    used = set()
    for _ in range(3):
        used.add(begin(memory, connection, robot, MUG))
        memory.end(connection, robot, MUG, Outcome("missed", "it slipped"))
    assert len(used) == 3
    assert begin(memory, connection, robot, MUG) not in used
    memory.end(connection, robot, MUG, Outcome())
    assert begin(memory, connection, robot, MUG) in used  # what failed before counts no more
    assert tried(connection) == {}


@pytest.mark.parametrize(
    ("trial", "counts", "by"), [(False, (0, 0), "assumed"), (True, (0.5, 0.5), "simulation")]
)
def test_a_simulated_pickup_counts_only_if_it_was_tried(
    connection: Connection, robot: int, trial: bool, counts: tuple[float, float], by: str
) -> None:
    memory = GraspMemory(simulated=True, trial=trial)
    choice = memory.begin(seen_by(connection), robot, MUG)
    assert choice.action is not None
    assert ("1 grasp tried in simulation" if trial else "not tried") in choice.note
    memory.end(connection, robot, MUG, Outcome())
    assert connection.execute(text(BY)).all() == [("completed", by, choice.action, *counts)]


BY = """
SELECT t.outcome, c.name, a.id, a.attempts, a.successes FROM task t
JOIN contributor c ON c.id = t.contributor_id JOIN action a ON a.id = t.action_id ORDER BY t.id
"""


def test_a_grasp_that_fails_in_simulation_is_not_used(connection: Connection, robot: int) -> None:
    """A mug of 40 kg is too heavy: the trials are stored, and the pickup does not begin."""
    heavy = "UPDATE entity SET properties = '{\"mass\": 40}' WHERE id = entity_id('mug')"
    connection.execute(text(heavy))
    memory = GraspMemory(simulated=True, trial=True)
    choice = memory.begin(seen_by(connection), robot, MUG)
    assert choice.action is None
    assert choice.refusal is not None
    assert "tried in simulation" in choice.refusal.message
    memory.end(connection, robot, MUG, choice.refusal)
    *trials, last = tasks(connection)
    assert trials
    assert {outcome for outcome, _, _ in trials} == {"error"}
    assert last == ("error", choice.refusal.message, None)
    assert all(successes == 0 < attempts for attempts, successes in tried(connection).values())


def test_own_outcomes_count_fully_and_an_object_that_is_gone_says_nothing(
    connection: Connection, robot: int
) -> None:
    memory = GraspMemory("parallel_gripper")
    action = begin(memory, connection, robot, MUG)
    memory.end(connection, robot, MUG, Outcome("gone", "mug is not there"))
    assert tasks(connection) == [("error", "mug is not there", None)]
    assert tried(connection) == {}
    assert begin(memory, connection, robot, MUG) == action
    memory.end(connection, robot, MUG, Outcome())
    assert tried(connection) == {action: (1.0, 1.0)}


def test_what_does_not_fit_is_refused_also_where_the_gripper_is_assumed(
    connection: Connection, robot: int
) -> None:
    table = Command("pickup", ("table",))
    refused = GraspMemory().begin(seen_by(connection), robot, table)
    assert refused.action is None
    assert refused.refusal is not None
    assert refused.refusal.cause == "unfit"
    assert "gripper parallel_gripper opens 0.09 m" in refused.refusal.message
    GraspMemory().end(connection, robot, table, refused.refusal)
    assert tasks(connection) == [("error", refused.refusal.message, None)]
    connection.execute(text("UPDATE gripper SET preferred = false"))  # as where none is stored
    assumed = GraspMemory().begin(seen_by(connection), robot, table)
    assert assumed.refusal is not None
    assert assumed.refusal.message.startswith("table: no grasp fits its shape")
    assert "parallel_gripper is assumed: gripper= names another one" in assumed.refusal.message


def test_what_has_no_mesh_is_picked_without_a_grasp(connection: Connection, robot: int) -> None:
    choice = GraspMemory(trial=True).begin(
        seen_by(connection), robot, Command("pickup", ("ghost",))
    )
    assert (choice.action, choice.refusal) == (None, None)
    assert choice.note.startswith("without a grasp: ghost: has no mesh")


def test_which_gripper_is_checked_before_a_mission(connection: Connection, robot: int) -> None:
    GraspMemory().check(connection, "tiago")
    with pytest.raises(LookupError, match="no gripper claw"):
        GraspMemory("claw").check(connection, "tiago")
    register_gripper(connection.connection.driver_connection, DEFAULT_GRIPPER, "second")
    connection.execute(text("UPDATE gripper SET preferred = false"))
    with (
        pytest.raises(LookupError, match="several grippers, and none is preferred"),
        connection.begin_nested(),
    ):
        GraspMemory().check(connection, "tiago")
    connection.execute(text("DELETE FROM gripper"))
    GraspMemory().check(connection, "tiago")


def test_an_unknown_gripper_is_an_error(connection: Connection, robot: int) -> None:
    with pytest.raises(LookupError, match="no gripper claw"):
        GraspMemory("claw").begin(seen_by(connection), robot, MUG)


def test_what_was_taken_is_put_down_and_both_are_a_put(connection: Connection, robot: int) -> None:
    """With the rights of a robot."""
    connection.execute(text("CREATE ROLE tiago IN ROLE semmap_robot"))
    connection.execute(text("SET LOCAL ROLE tiago"))
    memory = GraspMemory()
    grasp = begin(memory, connection, robot, MUG, PUT)
    memory.end(connection, robot, MUG, Outcome())
    take(connection, robot)
    (spot,) = memory.spots(seen_by(connection), robot, "mug", "table", Pose(2.2, 1.5)) or ()
    assert math.dist(spot[:2], (2.2, 1.5)) < 0.2
    assert 0.75 < spot.z < 0.76
    put = replace(PUT, spot=spot)
    place = begin(memory, connection, robot, put)
    memory.end(connection, robot, put, Outcome())
    statement = "SELECT kind, outcome, action_id, goal FROM task ORDER BY id"
    rows = [tuple(row) for row in connection.execute(text(statement))]
    whole = rows[2][2]
    assert rows == [
        ("grasp", "completed", grasp, None),
        ("place", "completed", place, pytest.approx(list(spot))),
        ("put", "completed", whole, pytest.approx(list(spot))),
    ]
    assert tried(connection) == {grasp: (1, 1), place: (1, 1), whole: (1, 1)}  # each once


def test_a_place_is_tried_in_simulation(connection: Connection, robot: int) -> None:
    """The mug is taken, put down and released, and it stays there."""
    memory = GraspMemory(simulated=True, trial=True)
    begin(memory, connection, robot, MUG, PUT)
    memory.end(connection, robot, MUG, Outcome())
    take(connection, robot)
    (spot,) = memory.spots(seen_by(connection), robot, "mug", "table", Pose(2.2, 1.5)) or ()
    put = replace(PUT, spot=spot)
    choice = memory.begin(seen_by(connection), robot, put)
    assert choice.tried
    assert choice.refusal is None
    memory.end(connection, robot, put, Outcome())
    assert set(tried(connection).values()) == {(0.5, 0.5)}  # grasp, place and put


def test_a_dropped_object_counts_against_the_place(connection: Connection, robot: int) -> None:
    memory = GraspMemory()
    grasp = begin(memory, connection, robot, MUG)
    memory.end(connection, robot, MUG, Outcome())
    take(connection, robot)
    (spot,) = memory.spots(seen_by(connection), robot, "mug", "table", Pose(2.2, 1.5)) or ()
    put = replace(PUT, spot=spot)
    place = begin(memory, connection, robot, put)
    memory.end(connection, robot, put, Outcome("dropped", "it fell"))
    counts = tried(connection)
    assert counts[grasp] == (1, 1)
    assert counts[place] == (1, 0)
    assert len(counts) == 3  # and the put
    assert set(counts.values()) == {(1, 1), (1, 0)}


def test_spots_are_not_known_for_floors_and_for_what_was_taken_without_a_grasp(
    connection: Connection, robot: int
) -> None:
    memory = GraspMemory()
    assert memory.spots(seen_by(connection), robot, "mug", "table", Pose()) is None
    memory.begin(seen_by(connection), robot, MUG, Command("place", ("mug", "room")))
    memory.end(connection, robot, MUG, Outcome())
    assert memory.spots(seen_by(connection), robot, "mug", "room", Pose()) is None
    assert memory.begin(seen_by(connection), robot, PUT).action is None


def test_where_the_gripper_fits_nowhere_there_are_no_spots(
    flat: semmap.Map, connection: Connection, robot: int
) -> None:
    memory = GraspMemory()
    memory.begin(seen_by(connection), robot, MUG)
    memory.end(connection, robot, MUG, Outcome())
    connection.execute(text(BOARD))
    assert memory.spots(seen_by(connection), robot, "mug", "table", Pose()) == []


BOARD = """
UPDATE placement SET pose = pose_compose(pose, '{0,0,-0.63,0,0,0,1}')
WHERE entity_id = entity_id('board')
"""
"""A board 12 cm above the table: room for the mug, and none for the gripper."""
