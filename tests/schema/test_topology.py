"""Routes in the database, over the view `route_edge`, are those of the planner."""

import math
from itertools import permutations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from planner.readers.robot_class import read_robot_class, store_robot_class
from planner.readers.topology import read_topology
from planner.readers.travel_times import MeasuredTravel, store_travel_times
from planner.robot_class import Durations, RobotClass
from planner.route import NoRouteError
from planner.route_search import find_route
from planner.routing_graph import RoutingGraph
from planner.topology import OUTSIDE, Place, PlaceConnector, Topology
from semmap.database import open_engine
from semmap.geometry.pose import Pose
from tests.planner.stored import store
from tests.seen import seen_by

NAMES = ("a", "b", "c", "low", "high")
LEVEL = {"low": 0.0, "high": 3.0}

DIJKSTRA = """
SELECT a.place AS start, b.place AS goal, min(d.agg_cost) AS cost
FROM pgr_dijkstraCost(
    'SELECT row_number() OVER (ORDER BY source, target) AS id, source, target, cost, reverse_cost
     FROM route_edge WHERE map_id = current_map() AND robot_class = ''tester''',
    'SELECT a.id AS source, b.id AS target FROM approach_pose a, approach_pose b
     WHERE a.map_id = current_map() AND b.map_id = a.map_id AND a.place <> b.place') d
JOIN approach_pose a ON a.id = d.start_vid JOIN approach_pose b ON b.id = d.end_vid
GROUP BY a.place, b.place
"""


@pytest.fixture(scope="module")
def routed(make_database):
    """A database with pgRouting."""
    engine = open_engine(make_database())
    try:
        with engine.begin() as connection:
            connection.execute(text("CREATE EXTENSION IF NOT EXISTS pgrouting SCHEMA public"))
    except DBAPIError as error:
        engine.dispose()
        pytest.skip(f"the server has no pgRouting: {error.orig}")
    yield engine
    engine.dispose()


coordinate = st.integers(-8, 8).map(float)
poses = st.builds(Pose.planar, coordinate, coordinate, z=st.sampled_from([0.0, 3.0]))


@st.composite
def topologies(draw):
    places = [Place(n) for n in ("a", "b", "c")]
    places += [Place(n, elevator="lift") for n in ("low", "high")]
    sides = [*permutations(NAMES, 2), *((n, OUTSIDE) for n in NAMES)]
    doors = draw(
        st.lists(
            st.builds(
                dict,
                places=st.sampled_from(sides),
                poses=st.tuples(poses, poses),
                type=st.sampled_from(["door", "door", "elevator_door", "stairs", "ramp"]),
                state=st.sampled_from(["open", "open", "closed", "locked"]),
                direction=st.sampled_from(["both", "both", "forward", "backward"]),
                behaviour=st.sampled_from(["pass_door", "push_door"]),
                width=st.sampled_from([None, 0.5, 0.9]),
            ),
            max_size=8,
        )
    )
    for door in doors:  # a cabin is on its storey
        door["poses"] = tuple(
            pose._replace(z=LEVEL.get(place, pose.z))
            for place, pose in zip(door["places"], door["poses"], strict=True)
        )
    return Topology.of(places, [PlaceConnector(f"d{i}", **door) for i, door in enumerate(doors)])


robots = st.builds(
    RobotClass,
    name=st.just("tester"),
    speed=st.sampled_from([0.5, 1.0]),
    behaviours=st.sampled_from(
        [None, frozenset({"pass_door"}), frozenset({"pass_door", "use_elevator"})]
    ),
    opens=st.booleans(),
    unlocks=st.booleans(),
    outside=st.booleans(),
)
times = st.builds(Durations, call=st.sampled_from([0.0, 8.0]), ride=st.just(7.0), open=st.just(2.0))


@settings(max_examples=20)
@given(topologies(), robots, times)
def test_pgr_dijkstra_finds_what_the_planner_finds(routed, topology, robot, times):
    with routed.connect() as connection:
        ids = store(connection, topology)
        number = store_robot_class(connection, robot, times)
        store_travel_times(seen_by(connection), number, straight(topology, ids, robot.speed), {})
        read = read_topology(seen_by(connection))
        graph = RoutingGraph(
            read, read_robot_class(seen_by(connection), "tester").robot, durations=times
        )
        edges = text("SELECT count(*) FROM route_edge WHERE cost >= 0 OR reverse_cost >= 0")
        costs = {}
        if connection.execute(edges).scalar():
            costs = {(r.start, r.goal): r.cost for r in connection.execute(text(DIJKSTRA))}
        for start, goal in permutations(NAMES, 2):
            cost = costs.get((start, goal))
            try:
                seconds = find_route(graph, graph.endpoint(start), graph.endpoint(goal)).seconds
            except NoRouteError:
                seconds = None
            assert cost == pytest.approx(seconds)
        connection.rollback()


def straight(topology, ids, speed):
    """The travel of a topology along straight lines."""
    stands = [
        (c.places[side], ids[c.name], c.poses[side])
        for c in topology.connectors.values()
        for side in (0, 1)
        if c.places[side] != OUTSIDE
    ]
    for place, a, p in stands:
        for other, b, q in stands:
            if place == other and a < b:
                metres = math.dist((p.x, p.y, p.z), (q.x, q.y, q.z))
                yield MeasuredTravel(ids[place], a, b, metres / speed, metres)
