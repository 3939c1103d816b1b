import math
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.graph_edges import StraightTravelCost, Travel
from planner.robot_class import Durations
from planner.route import NoRouteError, Route
from planner.topology import OUTSIDE, Place, PlaceConnector, Topology, UnknownPlaceError
from semmap.geometry.pose import Pose
from tests.planner.office import office, route


def names(found: Route) -> list[str]:
    return [step.connector.name for step in found.doors]


def test_figure_4_from_lab1_to_office4():
    found = route(office(), "lab1", "office4")
    assert names(found) == ["door1", "door2", "edoor1", "edoor3", "door5", "door6"]
    assert [(s.behaviour, s.from_place, s.to_place) for s in found.transitions] == [
        ("pass_door", "lab1", "corridor1"),
        ("pass_door", "corridor1", "foyer-1st"),
        ("call_elevator", "foyer-1st", "foyer-1st"),
        ("pass_door", "foyer-1st", "elevator-1st"),
        ("use_elevator", "elevator-1st", "elevator-3rd"),
        ("pass_door", "elevator-3rd", "foyer-3rd"),
        ("pass_door", "foyer-3rd", "corridor3"),
        ("pass_door", "corridor3", "office4"),
    ]


def test_of_two_doors_to_one_corridor_the_nearer_is_taken():
    assert names(route(office(), "office4", "lab2")) == ["door7", "door8"]
    assert names(route(office(), "office4", "foyer-3rd")) == ["door6", "door5"]
    # standing at the far door outweighs the way along the corridor
    assert names(route(office(), "office4", "corridor3", start_pose=Pose(9.0, 8.0, 6.4))) == [
        "door6"
    ]
    assert names(route(office(), "office4", "corridor3", start_pose=Pose(5.0, 8.0, 6.4))) == [
        "door7"
    ]
    assert names(route(office(), "corridor3", "office4", goal_pose=Pose(5.0, 8.0, 6.4))) == [
        "door7"
    ]


def test_a_step_approaches_facing_the_door_and_leaves_facing_away_from_it():
    step = route(office(), "lab1", "corridor1").transitions[0]
    assert (step.approach.x, step.approach.y) == pytest.approx((2.0, 3.3))
    assert (step.leave.x, step.leave.y) == pytest.approx((2.0, 4.7))
    for pose in (step.approach, step.leave):  # through the door, heading north
        np.testing.assert_allclose(pose.rotation_matrix[:, 0], [0, 1, 0], atol=1e-12)


def test_a_ride_ends_facing_the_door_of_its_cabin():
    ride = next(
        s for s in route(office(), "lab1", "lab2").transitions if s.behaviour == "use_elevator"
    )
    assert ride.elevator == "elevator"
    assert ride.connector is None
    assert ride.leave.z == pytest.approx(6.4)
    np.testing.assert_allclose(ride.leave.rotation_matrix[:, 0], [-1, 0, 0], atol=1e-12)


def test_cost_counts_metres_walked_and_the_ride():
    found = route(
        office(), "foyer-1st", "foyer-3rd", times=Durations(call=0.0, ride=7.0, ride_per_metre=2.0)
    )
    assert found.metres == pytest.approx(1.4 + 1.4)
    assert found.seconds == pytest.approx(2.8 + 7.0 + 2.0 * 6.4)


def test_a_room_to_itself_takes_no_step():
    assert route(office(), "lab1", "lab1").transitions == ()
    assert (
        route(office(), "lab1", "lab1", start_pose=Pose(), goal_pose=Pose(3, 4, 0)).seconds == 5.0
    )


def test_outside_is_crossed_only_where_it_is_allowed():
    assert names(route(office(), "lab1", "foyer-1st")) == ["door1", "door2"]
    with pytest.raises(NoRouteError, match=r"door1 is locked"):
        route(office(door1={"state": "locked"}), "lab1", "foyer-1st")
    found = route(office(door1={"state": "locked"}), "lab1", "foyer-1st", allow_outside=True)
    assert names(found) == ["side_door", "exit"]
    assert names(route(office(), "lab1", OUTSIDE)) == ["side_door"]
    assert names(route(office(), OUTSIDE, "corridor1")) == ["side_door", "door1"]


def test_a_locked_door_is_gone_around_or_named():
    locked = office(door6={"state": "locked"})
    assert names(route(locked, "foyer-3rd", "office4")) == ["door5", "door7"]
    assert names(route(locked, "foyer-3rd", "office4", allow_locked=True)) == ["door5", "door7"]
    cheap = Durations(unlock=0.0)
    assert (
        names(route(locked, "foyer-3rd", "office4", allow_locked=True, times=cheap))[1] == "door6"
    )
    with pytest.raises(NoRouteError, match=r"foyer-3rd to office4: door5 is locked$"):
        route(office(door5={"state": "locked"}), "foyer-3rd", "office4")


def test_a_closed_door_times_its_opening_and_may_be_forbidden():
    closed = office(door5={"state": "closed"})
    free = route(office(), "foyer-3rd", "corridor3").seconds
    assert route(closed, "foyer-3rd", "corridor3", times=Durations(open=3)).seconds == free + 3
    with pytest.raises(NoRouteError, match="door5 is closed"):
        route(closed, "foyer-3rd", "corridor3", allow_closed=False)


def test_direction_is_kept():
    one_way = office(door7={"direction": "forward"}, door6={"direction": "forward"})
    assert names(route(one_way, "corridor3", "office4")) == ["door6"]
    assert names(route(one_way, "office4", "foyer-3rd")) == ["door7", "door5"]
    with pytest.raises(NoRouteError, match="door5 leads only from foyer-3rd to corridor3"):
        route(office(door5={"direction": "forward"}), "lab2", "lab1")


def test_a_robot_passes_only_what_it_is_able_to():
    with pytest.raises(NoRouteError, match="nothing joins them without an elevator"):
        route(office(), "lab1", "lab2", behaviours={"pass_door"})
    needs = office(door5={"behaviour": "push_door"})
    with pytest.raises(NoRouteError, match="door5 needs the behaviour push_door"):
        route(needs, "lab1", "lab2", behaviours={"pass_door", "use_elevator"})


def test_an_elevator_door_that_says_call_elevator_is_called_once_and_passed():
    said = office(edoor1={"behaviour": "call_elevator"}, edoor3={"behaviour": "call_elevator"})
    behaviours = [s.behaviour for s in route(said, "foyer-1st", "foyer-3rd").transitions]
    assert behaviours == ["call_elevator", "pass_door", "use_elevator", "pass_door"]


def test_what_nothing_joins_is_said():
    islands = Topology.of([Place("a"), Place("b")], [])
    with pytest.raises(NoRouteError, match="a has no door"):
        route(islands, "a", "b")
    with pytest.raises(UnknownPlaceError, match=r"no place named lab; did you mean .*lab1"):
        route(office(), "lab", "office4")


def test_times_refuse_what_is_no_cost():
    for bad in (
        {"ride": 0.0},
        {"open": -1.0},
        {"unlock": math.nan},
        {"ride_per_metre": math.inf},
    ):
        with pytest.raises(ValueError, match="finite number"):
            Durations(**bad)


def test_another_measure_of_the_way_changes_the_door():
    class AlongTheWall(StraightTravelCost):
        """In the corridor the way to door6 is barred and long."""

        def between(self, place, a, b):
            metres = np.array([[math.hypot(p.x - q.x, p.y - q.y) for q in b] for p in a])
            if place == "corridor3":
                metres += 100.0 * np.array([[9 in (round(p.x), round(q.x)) for q in b] for p in a])
            return Travel(metres, metres)

    assert names(route(office(), "foyer-3rd", "office4", walks=AlongTheWall())) == [
        "door5",
        "door7",
    ]


# An oracle: enumerate every order of passing connectors that is possible, and add up.


def enumerate_cheapest(topology: Topology, start: str, goal: str, times: Durations) -> float:
    best = math.inf
    connectors = list(topology.connectors.values())
    for n in range(1, len(connectors) + 1):
        for order in permutations(connectors, n):
            for sides in np.ndindex(*(2,) * n):
                best = min(best, walk_through(topology, start, goal, times, order, sides))
    return best


def walk_through(topology, start, goal, times, order, sides):
    """Cost of passing connectors in this order from these sides; infinite where impossible."""
    at, place, total = None, start, 0.0
    for c, side in zip(order, sides, strict=True):
        if c.state == "locked" or not c.passes(side):
            return math.inf
        begin, end = c.poses[side], c.poses[1 - side]
        here = c.places[side]
        if here == place:
            total += math.dist(at.translation, begin.translation) if at else 0.0
        else:
            elevators = {topology.places[p].elevator for p in (here, place)}
            if len(elevators) != 1 or None in elevators:
                return math.inf
            height = begin.z - at.z if at else math.nan
            total += times.ride + times.ride_per_metre * abs(height)
        total += math.dist(begin.translation, end.translation)
        total += times.open if c.state == "closed" else 0.0
        at, place = end, c.places[1 - side]
    return total if place == goal else math.inf


coordinate = st.integers(-8, 8).map(float)
poses = st.builds(Pose.planar, coordinate, coordinate, z=st.sampled_from([0.0, 3.0]))


CABIN = {"low": Pose(0.0, 0.0, 0.0), "high": Pose(0.0, 0.0, 3.0)}


@st.composite
def topologies(draw):
    places = [Place(n) for n in ("a", "b", "c")] + [
        Place("low", elevator="lift"),
        Place("high", elevator="lift"),
    ]
    joined = draw(
        st.lists(
            st.tuples(
                st.sampled_from(list(permutations([p.name for p in places], 2))),
                st.tuples(poses, poses),
                st.sampled_from(["open", "open", "closed", "locked"]),
                st.sampled_from(["both", "both", "forward", "backward"]),
            ),
            max_size=4,
        )
    )
    return Topology.of(
        places,
        [
            PlaceConnector(
                f"d{i}",
                ends,
                # the cabin stands above itself: a ride saves no walk
                tuple(CABIN.get(end, pose) for end, pose in zip(ends, at, strict=True)),
                state=state,
                direction=direction,
            )
            for i, (ends, at, state, direction) in enumerate(joined)
        ],
    )


@settings(max_examples=60, deadline=None)
@given(topologies())
def test_no_order_of_doors_is_cheaper(topology):
    times = Durations(call=0.0, ride=5.0, ride_per_metre=1.0, open=2.0)
    expected = enumerate_cheapest(topology, "a", "b", times)
    if math.isinf(expected):
        with pytest.raises(NoRouteError):
            route(topology, "a", "b", times=times)
        return
    found = route(topology, "a", "b", times=times)
    assert found.seconds == pytest.approx(expected)
    passed = [(s.connector, s.connector.places.index(s.from_place)) for s in found.doors]
    order, sides = zip(*passed, strict=True)
    assert walk_through(topology, "a", "b", times, order, sides) == pytest.approx(expected)
