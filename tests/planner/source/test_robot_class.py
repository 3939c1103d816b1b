"""Classes of robots, written and read."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from navgrid.terrain import DriveLimits
from planner.robot_class import RobotClass
from planner.source.robot_class import (
    class_state,
    delete_robot_class,
    keep_robot_class,
    read_robot_class,
    read_robot_names,
)
from planner.source.walks import Walk, keep_walks, read_walks
from planner.times import Times
from semmap.robot import Part

SQUARE = np.array([(-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)])
BASE = Part("base", ("base_link", "wheels"), (0.0, 0.31), SQUARE, 0.2, 0.36, "inscribed")
MAST = Part("mast", ("mast",), (0.31, 1.4), SQUARE / 3, 0.07, 0.12, "circumscribed")

lengths = st.floats(0.01, 5.0)
ranges = st.tuples(st.floats(0, 1), st.floats(1.01, 3))
words = st.frozensets(st.sampled_from(["pass_door", "use_elevator", "ward", "night"]))
classes = st.builds(
    RobotClass, name=st.just("tester"), parts=st.sampled_from([(), (BASE,), (BASE, MAST)]),
    gait=st.builds(DriveLimits, st.floats(0, 0.3), st.floats(0, 1)), speed=lengths,
    behaviours=st.one_of(st.none(), words), permissions=words, opens=st.booleans(),
    unlocks=st.booleans(), outside=st.booleans(), reach=ranges, heights=ranges,
    capacity=st.integers(1, 9),
)  # fmt: skip
times = st.builds(Times, **dict.fromkeys(("call", "ride", "ride_per_metre", "open"), lengths))


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(classes, times)
def test_what_is_read_is_what_was_kept(connection, robot, took):
    keep_robot_class(connection, robot, took)
    kept = read_robot_class(connection, "tester")
    assert kept.times == took
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
    [({"speed": 0.4}, True), ({"parts": (BASE,)}, True), ({"gait": DriveLimits(0.1, 0.2)}, True),
     ({"opens": False}, False), ({"capacity": 3}, False), ({}, False)],
)  # fmt: skip
def test_walks_of_another_shape_gait_or_speed_are_forgotten(connection, change, forgotten):
    number = keep_robot_class(connection, RobotClass("tester", (BASE, MAST)))
    place, a, b = connection.execute(
        text("SELECT id FROM entity WHERE map_id = current_map() AND name IN "
             "('lab1', 'door1', 'entrance') ORDER BY name = 'lab1' DESC, id")
    ).scalars()  # fmt: skip
    keep_walks(connection, number, [Walk(place, a, b, 3.0, 2.0)], {place: "as it was"})
    changed = {"parts": (BASE, MAST), **change}
    assert keep_robot_class(connection, RobotClass("tester", **changed)) == number
    assert len(read_walks(connection, number)) == (0 if forgotten else 1)


def test_learned_times_come_with_it_in_the_map_where_they_were_learned(connection):
    number = keep_robot_class(connection, RobotClass("tester"))
    door = connection.execute(
        text("SELECT id FROM entity WHERE map_id = current_map() AND name = 'door1'")
    ).scalar_one()
    for seconds, succeeded in ((4.0, True), (8.0, True), (99.0, False)):
        connection.execute(
            text("INSERT INTO execution (robot_class_id, entity_id, behaviour, seconds, succeeded) "
                 "VALUES (:robot, :door, 'pass_door', :seconds, :succeeded)"),
            {"robot": number, "door": door, "seconds": seconds, "succeeded": succeeded},
        )  # fmt: skip
    assert read_robot_class(connection, "tester").times.learned == {("pass_door", "door1"): 6.0}
    connection.execute(text("INSERT INTO map (name) VALUES ('elsewhere')"))
    connection.execute(text("SELECT set_config('semmap.map', 'elsewhere', true)"))
    assert read_robot_class(connection, "tester").times.learned == {}


def test_its_state_changes_with_it_and_goes_with_it(connection):
    number = keep_robot_class(connection, RobotClass("tester"))
    first = read_robot_class(connection, "tester").state
    assert class_state(connection, number) == first
    keep_robot_class(connection, RobotClass("tester"))
    assert class_state(connection, number) == first
    keep_robot_class(connection, RobotClass("tester", capacity=2))
    assert class_state(connection, number) not in (None, first)
    assert "tester" in read_robot_names(connection)
    delete_robot_class(connection, "tester")
    assert class_state(connection, number) is None
    assert "tester" not in read_robot_names(connection)


def test_an_unknown_class_is_named_with_those_there_are(connection):
    keep_robot_class(connection, RobotClass("porter"))
    for ask in (read_robot_class, delete_robot_class):
        with pytest.raises(LookupError, match=r"no class of robots named potter; .*porter"):
            ask(connection, "potter")
