"""Classes of robots, written and read."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from navgrid.terrain import DriveLimits
from planner.readers.robot_class import (
    delete_robot_class,
    read_robot_class,
    read_robot_class_digest,
    read_robot_class_names,
    store_robot_class,
)
from planner.readers.travel_times import MeasuredTravel, read_travel_times, store_travel_times
from planner.robot_class import Durations, RobotClass
from semmap.robot import Part
from tests.seen import seen_by

SQUARE = np.array([(-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)])
BASE = Part("base", ("base_link", "wheels"), (0.0, 0.31), SQUARE, 0.2, 0.36)
MAST = Part("mast", ("mast",), (0.31, 1.4), SQUARE / 3, 0.07, 0.12)

lengths = st.floats(0.01, 5.0)
ranges = st.tuples(st.floats(0, 1), st.floats(1.01, 3))
words = st.frozensets(st.sampled_from(["pass_door", "use_elevator", "ward", "night"]))
classes = st.builds(
    RobotClass,
    name=st.just("tester"),
    parts=st.sampled_from([(), (BASE,), (BASE, MAST)]),
    drive_limits=st.builds(DriveLimits, st.floats(0, 0.3), st.floats(0, 1)),
    speed=lengths,
    behaviours=st.one_of(st.none(), words),
    permissions=words,
    opens=st.booleans(),
    unlocks=st.booleans(),
    outside=st.booleans(),
    reach=ranges,
    heights=ranges,
    capacity=st.integers(1, 9),
)
times = st.builds(Durations, **dict.fromkeys(("call", "ride", "ride_per_metre", "open"), lengths))


def test_whole_numbers_are_metres(connection):
    robot = RobotClass("tester", reach=(0, 1.5), heights=(0, 2.5))
    store_robot_class(connection, robot)
    kept = read_robot_class(seen_by(connection), "tester").robot
    assert (kept.reach, kept.heights) == ((0.0, 1.5), (0.0, 2.5))


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(classes, times)
def test_what_is_read_is_what_was_kept(connection, robot, took):
    store_robot_class(connection, robot, took)
    kept = read_robot_class(seen_by(connection), "tester")
    assert kept.durations == took
    for name, said in vars(robot).items():
        if name != "parts":
            assert getattr(kept.robot, name) == said
    for part, again in zip(robot.parts, kept.robot.parts, strict=True):
        np.testing.assert_array_equal(part.footprint, again.footprint)
        assert [(k, v) for k, v in vars(part).items() if k != "footprint"] == [
            (k, v) for k, v in vars(again).items() if k != "footprint"
        ]


@pytest.mark.parametrize(
    ("change", "forgotten"),
    [
        ({"speed": 0.4}, True),
        ({"parts": (BASE,)}, True),
        ({"drive_limits": DriveLimits(0.1, 0.2)}, True),
        ({"opens": False}, False),
        ({"capacity": 3}, False),
        ({}, False),
    ],
)
def test_walks_of_another_shape_gait_or_speed_are_forgotten(connection, change, forgotten):
    number = store_robot_class(connection, RobotClass("tester", (BASE, MAST)))
    place, a, b = connection.execute(
        text(
            "SELECT id FROM entity WHERE map_id = current_map() AND name IN "
            "('lab1', 'door1', 'entrance') ORDER BY name = 'lab1' DESC, id"
        )
    ).scalars()
    store_travel_times(
        seen_by(connection), number, [MeasuredTravel(place, a, b, 3.0, 2.0)], {place: "as it was"}
    )
    changed = {"parts": (BASE, MAST), **change}
    assert store_robot_class(connection, RobotClass("tester", **changed)) == number
    assert len(read_travel_times(seen_by(connection), number)) == (0 if forgotten else 1)


def test_learned_times_come_with_it_in_the_map_where_they_were_learned(connection):
    number = store_robot_class(connection, RobotClass("tester"))
    door = connection.execute(
        text("SELECT id FROM entity WHERE map_id = current_map() AND name = 'door1'")
    ).scalar_one()
    for seconds, succeeded in ((4.0, True), (8.0, True), (99.0, False)):
        connection.execute(
            text(
                "INSERT INTO execution (robot_class_id, entity_id, behaviour, seconds, succeeded) "
                "VALUES (:robot, :door, 'pass_door', :seconds, :succeeded)"
            ),
            {"robot": number, "door": door, "seconds": seconds, "succeeded": succeeded},
        )
    assert read_robot_class(seen_by(connection), "tester").durations.measured == {
        ("pass_door", "door1"): 6.0
    }
    connection.execute(text("INSERT INTO map (name) VALUES ('elsewhere')"))
    connection.execute(text("SELECT set_config('semmap.map', 'elsewhere', true)"))
    assert read_robot_class(seen_by(connection), "tester").durations.measured == {}


def test_its_state_changes_with_it_and_goes_with_it(connection):
    number = store_robot_class(connection, RobotClass("tester"))
    first = read_robot_class(seen_by(connection), "tester").digest
    assert read_robot_class_digest(seen_by(connection), number) == first
    store_robot_class(connection, RobotClass("tester"))
    assert read_robot_class_digest(seen_by(connection), number) == first
    store_robot_class(connection, RobotClass("tester", capacity=2))
    assert read_robot_class_digest(seen_by(connection), number) not in (None, first)
    assert "tester" in read_robot_class_names(seen_by(connection))
    delete_robot_class(connection, "tester")
    assert read_robot_class_digest(seen_by(connection), number) is None
    assert "tester" not in read_robot_class_names(seen_by(connection))


def test_an_unknown_class_is_named_with_those_there_are(connection):
    store_robot_class(connection, RobotClass("porter"))
    for ask, taken in (
        (read_robot_class, seen_by(connection)),
        (delete_robot_class, connection),
    ):
        with pytest.raises(LookupError, match=r"no robot class named potter; .*porter"):
            ask(taken, "potter")
