"""What bars a robot from a connector, in Python and in the database alike."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from navgrid.terrain import DriveLimits
from planner.readers.robot_class import read_robot_class, store_robot_class
from planner.readers.topology import read_topology
from planner.robot_class import RobotClass
from planner.topology import OUTSIDE, Place, PlaceConnector, Topology
from semmap.geometry.pose import Pose
from semmap.robot import Part
from tests.planner.stored import store
from tests.seen import seen_by


def part(width, low, high):
    half = width / 2
    corners = np.array([[-0.3, -half], [0.3, -half], [0.3, half], [-0.3, half]])
    return Part(f"{low:g}", ("link",), (low, high), corners, half, 0.3 + half)


shapes = st.one_of(
    st.just(()),
    st.tuples(
        st.builds(part, st.sampled_from([0.4, 0.7]), st.just(0.0), st.just(0.4)),
        st.builds(part, st.sampled_from([0.2, 0.9]), st.just(0.4), st.sampled_from([1.0, 1.8])),
    ),
)
words = st.frozensets(st.sampled_from(["staff", "night"]))
robots = st.builds(
    RobotClass,
    st.just("tester"),
    shapes,
    st.builds(DriveLimits, st.sampled_from([0.02, 0.1]), st.sampled_from([0.1, 0.3])),
    behaviours=st.sampled_from([None, frozenset({"pass_door"})]),
    permissions=words,
    opens=st.booleans(),
    unlocks=st.booleans(),
)
lengths = st.sampled_from([None, 0.6, 0.8, 1.2, 2.0])
connectors = st.builds(
    PlaceConnector,
    st.just("d"),
    st.just(("a", OUTSIDE)),
    st.tuples(
        st.just(Pose()),
        st.builds(Pose.planar, st.just(2.0), st.just(0.0), z=st.sampled_from([0.0, 0.3, -0.5])),
    ),
    st.sampled_from(["door", "elevator_door", "stairs", "ramp"]),
    st.sampled_from(["both", "forward", "backward"]),
    st.sampled_from(["open", "closed", "locked"]),
    st.sampled_from(["pass_door", "push_door"]),
    lengths,
    lengths,
    st.sampled_from([0.0, 0.05, 0.2]),
    words,
)


@settings(max_examples=30)
@given(robots, connectors)
def test_the_view_bars_what_the_planner_bars(module_engine, robot, connector):
    topology = Topology.of([Place("a")], [connector])
    with module_engine.connect() as connection:
        store(connection, topology)
        number = store_robot_class(connection, robot)
        again = read_robot_class(seen_by(connection), "tester").robot
        (read,) = read_topology(seen_by(connection)).connectors.values()
        costs = connection.execute(
            text("SELECT cost, reverse_cost FROM route_edge WHERE robot_class_id = :id"),
            {"id": number},
        ).one()
        connection.rollback()
    barred = [robot.blocking_reason(connector, side) for side in (0, 1)]
    assert [c < 0 for c in costs] == [why is not None for why in barred]
    assert [again.blocking_reason(read, side) for side in (0, 1)] == barred


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"speed": 0.0}, "its speed is 0.0 m/s; give one above 0"),
        ({"speed": math.nan}, "its speed is nan m/s"),
        ({"capacity": 0}, "its capacity is 0 objects; give 1 or more"),
        ({"reach": (0.8, 0.2)}, "reach is 0.8 to 0.2 m; give the lower end first"),
        ({"heights": (0.0, math.inf)}, "heights is 0.0 to inf m"),
        ({"name": ""}, "name of a robot class is empty"),
        ({"parts": (part(0.4, 0.0, 0.01),)}, "its part 0 ends at 0.010 m, below a step of 0.02 m"),
    ],
)
def test_what_is_no_robot_is_refused(more, message):
    with pytest.raises(ValueError, match=message):
        RobotClass(**more)
