"""The graph is the stands' graph, as SciPy's Dijkstra on one made by hand says."""

import math
import threading
from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from planner.graph_edges import Penalties, StraightTravelCost, Travel, TravelEdges
from planner.robot_class import Durations, RobotClass
from planner.route import NoRouteError
from planner.route_search import find_alternatives, find_route, seconds_between
from planner.routing_graph import RoutingGraph
from planner.topology import OUTSIDE, Place, PlaceConnector, Topology
from semmap.geometry.pose import Pose
from tests.planner.office import office

NAMES = ("a", "b", "c", "low", "high")
FLOOR = {"low": 0.0, "high": 3.0}
TIMES = Durations(call=3.0, ride=5.0, ride_per_metre=1.0, open=2.0, unlock=4.0)


class Crooked(StraightTravelCost):
    """Walks of made-up lengths, the same there and back, some of them impossible."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.asked: list[str] = []

    def between(self, place, a, b):
        self.asked.append(place)
        seconds = np.array([[self._one(place, p, q) for q in b] for p in a])
        seconds = seconds.reshape(len(a), len(b))
        return Travel(seconds, 2 * seconds)

    def _one(self, place, p, q):
        ends = sorted([(p.x, p.y, p.z, p.yaw), (q.x, q.y, q.z, q.yaw)])
        if ends[0] == ends[1]:
            return 0.0
        number = hash((self.seed, NAMES.index(place) if place in NAMES else 9, *ends)) % 40
        return math.inf if number == 0 else float(number)


coordinate = st.integers(-8, 8).map(float)
poses = st.builds(
    Pose.planar, coordinate, coordinate, st.sampled_from([0.0, math.pi / 2, 2.0]), st.just(0.0)
)


@st.composite
def topologies(draw):
    places = [Place(n, storey="s") for n in ("a", "b", "c")]
    places += [Place(n, elevator="lift", storey=f"s{n}") for n in ("low", "high")]
    doors = draw(
        st.lists(
            st.builds(
                dict,
                places=st.sampled_from([*permutations(NAMES, 2), *((n, OUTSIDE) for n in NAMES)]),
                poses=st.tuples(poses, poses),
                type=st.sampled_from(["door", "door", "elevator_door"]),
                state=st.sampled_from(["open", "open", "closed", "locked"]),
                direction=st.sampled_from(["both", "both", "forward", "backward"]),
            ),
            max_size=9,
        )
    )
    for door in doors:
        door["poses"] = tuple(
            pose._replace(z=FLOOR.get(place, pose.z))
            for place, pose in zip(door["places"], door["poses"], strict=True)
        )
    return Topology.of(places, [PlaceConnector(f"d{i}", **door) for i, door in enumerate(doors)])


robots = st.builds(
    RobotClass,
    opens=st.booleans(),
    unlocks=st.booleans(),
    outside=st.booleans(),
    behaviours=st.sampled_from([None, frozenset({"pass_door"})]),
)
seeds = st.integers(0, 1000)


def oracle(topology, robot, walks, starts, goals, more=None):
    """Seconds from (place, pose) to (place, pose), by SciPy; `more` seconds by connector's name."""
    connectors = [*topology.connectors.values()]
    stands = [(i, s) for i in range(len(connectors)) for s in (0, 1)]
    place = {(i, s): connectors[i].places[s] for i, s in stands}
    pose = {(i, s): connectors[i].poses[s] for i, s in stands}
    nodes = {}

    def node(key):
        return nodes.setdefault(key, len(nodes))

    edges = {}

    def edge(a, b, seconds):
        if seconds < math.inf:
            key = (node(a), node(b))
            edges[key] = min(edges.get(key, math.inf), seconds)

    def walk(where, p, q):
        if where == OUTSIDE:
            return math.dist((p.x, p.y, p.z), (q.x, q.y, q.z)) / robot.speed
        return float(walks.between(where, [p], [q]).seconds[0, 0])

    elevator = {n: topology.places[n].elevator for n in topology.places}
    for i, s in stands:
        c = connectors[i]
        barred = (
            (c.state == "locked" and not robot.unlocks)
            or (c.state == "closed" and c.type == "door" and not robot.opens)
            or c.direction == ("backward", "forward")[s]
        )
        if barred:
            continue
        p, q = c.poses[s], c.poses[1 - s]
        seconds = math.dist((p.x, p.y, p.z), (q.x, q.y, q.z)) / robot.speed
        if c.state == "closed" and c.type == "door":
            seconds += TIMES.open
        if c.state == "locked":
            seconds += TIMES.unlock
        there = elevator[c.places[1 - s]]
        if there is not None and there != elevator[c.places[s]]:
            seconds += TIMES.call
        edge(("leave", i, s), ("come", i, 1 - s), seconds + (more or {}).get(c.name, 0.0))
    for a, b in permutations(stands, 2):
        if place[a] == place[b] and (place[a] != OUTSIDE or robot.outside):
            edge(("come", *a), ("leave", *b), walk(place[a], pose[a], pose[b]))
        e, f = elevator[place[a]], elevator[place[b]]
        if place[a] != place[b] and e is not None and e == f and robot.rides_elevators:
            p, q = pose[a], pose[b]
            ride = TIMES.ride + TIMES.ride_per_metre * abs(p.z - q.z)
            edge(("come", *a), ("leave", *b), ride + math.hypot(p.x - q.x, p.y - q.y) / robot.speed)
    for k, (where, at) in enumerate(starts):
        for s in (s for s in stands if place[s] == where):
            seconds = 0.0 if at is None else walk(where, at, pose[s])
            edge(("start", k), ("leave", *s), seconds)
            if elevator[where] is not None:
                edge(("start", k), ("come", *s), seconds)
    for k, (where, at) in enumerate(goals):
        for s in (s for s in stands if place[s] == where):
            seconds = 0.0 if at is None else walk(where, pose[s], at)
            edge(("come", *s), ("goal", k), seconds)
            if elevator[where] is not None:
                edge(("leave", *s), ("goal", k), seconds)
    for (j, (here, p)), (k, (there, q)) in product(enumerate(starts), enumerate(goals)):
        if here == there:
            edge(("start", j), ("goal", k), 0.0 if p is None or q is None else walk(here, p, q))
    first, last = (
        [node((w, k)) for k in range(len(of))] for w, of in (("start", starts), ("goal", goals))
    )
    tiny = 1e-12  # SciPy takes no edge of weight zero
    keys = np.array([*edges]).reshape(-1, 2)
    values = np.array([*edges.values()]) + tiny
    matrix = coo_matrix((values, keys.T.astype(int)), shape=(len(nodes), len(nodes))).tocsr()
    return dijkstra(matrix, indices=first)[:, last]


sites = st.lists(
    st.tuples(st.sampled_from(NAMES), st.one_of(st.none(), poses)), min_size=1, max_size=3
)


@settings(max_examples=40)
@given(topologies(), robots, seeds, sites, sites)
def test_times_and_routes_are_those_of_scipy(topology, robot, seed, starts, goals):
    walks = Crooked(seed)
    graph = RoutingGraph(topology, robot, durations=TIMES, costs=walks)
    a, b = ([graph.endpoint(*s) for s in sites] for sites in (starts, goals))
    expected = oracle(topology, robot, walks, starts, goals)
    found = seconds_between(graph, a, b)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    for (i, start), (j, goal) in product(enumerate(a), enumerate(b)):
        if math.isinf(expected[i, j]):
            with pytest.raises(NoRouteError, match=f"no route from {start.place} to {goal.place}"):
                find_route(graph, start, goal)
            continue
        route = find_route(graph, start, goal)
        assert route.seconds == pytest.approx(expected[i, j], abs=1e-9)
        whole(route, start, goal)
        others = find_alternatives(graph, start, goal, 3)
        assert others[0].seconds == pytest.approx(route.seconds)
        assert [o.seconds for o in others] == sorted(o.seconds for o in others)
        assert len({tuple(map(step_of, o.steps)) for o in others}) == len(others)
        for other in others:
            whole(other, start, goal)


def step_of(step):
    return (
        step.behaviour,
        step.connector and step.connector.name,
        step.from_place,
        step.to_place,
        step.leave,
    )


def whole(route, start, goal):
    """Steps add up to the route, and each begins where the last ended."""
    assert math.fsum(s.seconds for s in route.steps) == pytest.approx(route.seconds)
    assert math.fsum(s.metres for s in route.steps) == pytest.approx(route.metres)
    place, at = start.place, start.pose
    for step in route.steps:
        assert step.from_place == place
        assert step.approach == at or at is None
        place, at = step.to_place, step.leave
    assert place == goal.place
    if goal.pose is not None:
        assert at == goal.pose


def kept_of(graph):
    """Its walks, as they are kept."""
    walks = slice(2 * len(graph.connectors), len(graph.tails) - len(graph.rides))
    return TravelEdges(
        graph.tails[walks].astype(np.int64),
        graph.heads[walks].astype(np.int64),
        graph.base[walks],
        graph.metres[walks],
    )


def edges_of(graph):
    """All edges by what they join."""
    rows = zip(
        graph.tails,
        graph.heads,
        graph.seconds,
        graph.base,
        graph.metres,
        graph.graph.weights,
        strict=True,
    )
    return sorted(tuple(map(float, row)) for row in rows)


@settings(max_examples=40)
@given(topologies(), robots, seeds, st.randoms(use_true_random=False))
def test_kept_walks_are_taken_in_any_order(topology, robot, seed, chance):
    graph = RoutingGraph(topology, robot, durations=TIMES, costs=Crooked(seed))
    kept = kept_of(graph)
    order = [*range(len(kept.tails))]
    chance.shuffle(order)
    again = Crooked(seed)
    other = RoutingGraph(
        topology, robot, durations=TIMES, costs=again, stored=kept.take(np.array(order, int))
    )
    assert edges_of(other) == edges_of(graph)
    assert not again.asked
    assert set(other.measured) <= {OUTSIDE}


def test_of_a_place_with_a_missing_walk_all_are_measured():
    topology = office()
    graph = RoutingGraph(topology)
    kept = kept_of(graph)
    lost = next(
        i
        for i, (a, b) in enumerate(zip(kept.tails, kept.heads, strict=True))
        if graph.place_of[a] == "corridor3" and a < b
    )
    other = RoutingGraph(topology, stored=kept.take(np.arange(len(kept.tails)) != lost))
    assert set(other.measured) == {"corridor3", OUTSIDE}
    assert edges_of(other) == edges_of(graph)


@settings(max_examples=40)
@given(topologies(), robots, seeds, st.data())
def test_a_changed_connector_equals_a_fresh_one(topology, robot, seed, data):
    assume(topology.connectors)
    graph = RoutingGraph(topology, robot, durations=TIMES, costs=Crooked(seed))
    for _ in range(3):
        name = data.draw(st.sampled_from(sorted(topology.connectors)))
        changed = replace(
            topology.connectors[name],
            state=data.draw(st.sampled_from(["open", "closed", "locked"])),
            direction=data.draw(st.sampled_from(["both", "forward", "backward"])),
        )
        graph.change_connector(changed)
        topology = replace(topology, connectors={**topology.connectors, name: changed})
        assert edges_of(graph) == edges_of(
            RoutingGraph(topology, robot, durations=TIMES, costs=Crooked(seed))
        )


@settings(max_examples=40)
@given(topologies(), robots, seeds, seeds)
def test_changed_travel_times_equal_fresh_ones(topology, robot, seed, other):
    walks = Crooked(seed)
    graph = RoutingGraph(topology, robot, durations=TIMES, costs=walks)
    walks.seed = other
    for place in topology.places:
        graph.measure_again(place)
    fresh = RoutingGraph(topology, robot, durations=TIMES, costs=Crooked(other))
    assert edges_of(graph) == edges_of(fresh)


def test_a_connector_that_joins_other_places_is_refused():
    graph = RoutingGraph(office())
    moved = replace(graph.topology.connectors["door5"], places=("foyer-3rd", "lab2"))
    before = edges_of(graph)
    with pytest.raises(
        ValueError, match="door5 now joins other places or has other poses: make a new graph"
    ):
        graph.change_connector(moved)
    assert edges_of(graph) == before


@settings(max_examples=40)
@given(topologies(), robots, seeds, st.data())
def test_penalties_hold_as_long_as_they_are_asked_for(topology, robot, seed, data):
    assume(topology.connectors)
    walks = Crooked(seed)
    graph = RoutingGraph(topology, robot, durations=TIMES, costs=walks)
    before = edges_of(graph)
    more = data.draw(
        st.dictionaries(
            st.sampled_from(sorted(topology.connectors)),
            st.one_of(st.just(math.inf), st.integers(0, 60).map(float)),
        )
    )
    edges = {2 * graph.index[n] + s: v for n, v in more.items() for s in (0, 1)}
    seconds = {e: v for e, v in edges.items() if v < math.inf}
    blocked = {e: "it is to be avoided" for e, v in edges.items() if math.isinf(v)}
    ends = [(n, None) for n in NAMES]
    sites = [graph.endpoint(*end) for end in ends]
    with graph.penalised(Penalties(seconds, blocked)):
        expected = oracle(topology, robot, walks, ends, ends, more)
        np.testing.assert_allclose(seconds_between(graph, sites, sites), expected, atol=1e-9)
    assert edges_of(graph) == before
    with pytest.raises(ZeroDivisionError), graph.penalised(Penalties(seconds, blocked)):
        raise ZeroDivisionError
    assert edges_of(graph) == before


def test_penalties_choose_and_do_not_count():
    graph = RoutingGraph(office())
    a, b = graph.endpoint("office4"), graph.endpoint("lab2")
    plain = find_route(graph, a, b)
    with graph.penalised(Penalties({2 * graph.index["door8"]: 100.0})):
        assert find_route(graph, a, b).seconds == plain.seconds


def test_changes_wait_until_penalties_are_gone():
    graph = RoutingGraph(office())
    locked = replace(graph.topology.connectors["door5"], state="locked")
    changing = threading.Thread(target=graph.change_connector, args=(locked,))
    with graph.penalised(Penalties({0: 5.0})):
        changing.start()
        changing.join(0.1)
        assert changing.is_alive()
        assert math.isfinite(graph.graph.weights[2 * graph.index["door5"]])
    changing.join()
    assert math.isinf(graph.graph.weights[2 * graph.index["door5"]])


def test_where_two_stands_meet_the_robot_turns():
    """Two doors whose stands are one point: no way between them, but another heading."""
    corner = (Pose(), Pose.planar(1.0, 0.0, 0.0)), (Pose.planar(1.0, 0.0, 2.0), Pose(1.0, 2.0))
    topology = Topology.of(
        [Place("a"), Place("b"), Place("c")],
        [
            PlaceConnector("first", ("a", "b"), corner[0]),
            PlaceConnector("second", ("b", "c"), corner[1]),
        ],
    )
    graph = RoutingGraph(topology)
    start, goal = graph.endpoint("a", Pose()), graph.endpoint("c", Pose(1.0, 3.0))
    route = find_route(graph, start, goal)
    assert [s.behaviour for s in route.steps] == ["pass_door", "navigate", "pass_door", "navigate"]
    whole(route, start, goal)


@pytest.mark.parametrize(("start", "goal"), [("lab1", "office4"), ("office4", "lab1")])
def test_a_ride_waits_for_one_call_in_the_time_as_in_the_steps(start, goal):
    found = {}
    for call in (0.0, 100.0):
        graph = RoutingGraph(office(), RobotClass(), durations=Durations(call=call))
        a, b = graph.endpoint(start), graph.endpoint(goal)
        found[call] = float(seconds_between(graph, [a], [b])[0, 0])
        steps = find_route(graph, a, b).steps
        assert sum(s.seconds for s in steps) == pytest.approx(found[call])
        assert [s.seconds for s in steps if s.behaviour == "call_elevator"] == [call]
    assert found[100.0] - found[0.0] == pytest.approx(100.0)
