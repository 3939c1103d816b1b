"""Questions as people ask them, on the office and on plain topologies."""

import math
from contextlib import suppress
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest
import shapely

from planner.cost_rules import CostRules
from planner.location import LocatedEntity
from planner.robot_class import RobotClass
from planner.route import NoRouteError
from planner.route_planner import RoutePlanner
from planner.routing_graph import RoutingGraph
from planner.topology import Place, PlaceConnector, PlaceRegion, Topology, UnknownPlaceError
from semmap.geometry.pose import Pose
from tests.planner.office import office
from tests.planner.test_storey_costmaps import ROBOT, ground, rooms

NOON, NIGHT = datetime(2024, 5, 5, 12), datetime(2024, 5, 5, 23)


def doors(route):
    return [s.connector.name for s in route.doors]


class Lookup:
    """Finds given entities, and one place everywhere."""

    def __init__(self, entities, place=None):
        self.entities, self.place = entities, place

    def find(self, word):
        return self.entities.get(word, ())

    def place_at(self, pose):
        return self.place

    def similar_names(self, word):
        return ()


@pytest.fixture
def planner(office_live):
    made = RoutePlanner.of_live(office_live)
    made.rng = np.random.default_rng(7)
    return made


def test_to_a_thing_means_to_a_pose_from_which_it_is_reached(planner):
    route = planner.route("lab1", "muffin1")
    assert route.goal == "office4"
    end = route.steps[-1].leave
    (muffin,) = planner.lookup.find("muffin1")
    away = shapely.Point(end.x, end.y).distance(muffin.footprint)
    assert 0.2 <= away <= 0.8
    facing = math.atan2(muffin.pose.y - end.y, muffin.pose.x - end.x)
    assert math.cos(end.yaw - facing) > 0.99
    assert end.z == pytest.approx(7.0)


def test_of_a_type_the_nearest_is_meant(planner):
    for start in ("foyer-1st", "foyer-3rd", "office4", "meeting1"):
        nearest = min(
            (planner.route(start, n) for n in ("meeting1", "meeting3")),
            key=lambda r: r.seconds,
        )
        found = planner.route(start, "meeting_room")
        assert (found.goal, found.seconds) == (nearest.goal, pytest.approx(nearest.seconds))
    assert planner.route("lab1", "kitchen").goal == "kitchen"
    one = planner.route("kitchen", "potted_plant")
    all_of = []
    for plant in planner.lookup.find("potted_plant"):
        with suppress(NoRouteError):  # one stands behind the conference table
            all_of.append(planner.route("kitchen", plant).seconds)
    assert one.seconds == pytest.approx(min(all_of))
    assert len(all_of) > 3


def test_home_is_a_region_from_which_a_pose_is_drawn(planner):
    (home,) = planner.lookup.find("home")
    ends = set()
    for _ in range(5):
        route = planner.route("office4", "home")
        assert route.goal == "lab1"
        end = route.steps[-1].leave
        assert home.footprint.covers(shapely.Point(end.x, end.y))
        ends.add((end.x, end.y))
    assert len(ends) > 1


def test_poses_are_starts_and_goals(planner):
    route = planner.route(Pose(8.0, 5.2, 0.0), Pose(8.0, 5.0, 7.0))
    assert (route.start, route.goal) == ("corridor1", "corridor3")
    assert route.steps[0].approach == Pose(8.0, 5.2, 0.0)
    assert route.steps[-1].leave == Pose(8.0, 5.0, 7.0)
    assert math.fsum(s.seconds for s in route.steps) == pytest.approx(route.seconds)
    with pytest.raises(NoRouteError, match=r"\(80.00, 5.20, 0.00\) is in no room"):
        planner.route(Pose(80.0, 5.2), "lab1")


def test_a_start_inside_a_wall_names_the_wall(planner):
    with pytest.raises(
        NoRouteError, match=r"tester cannot stand at .* in lab1: bookshelf1.* is in"
    ):
        planner.route(Pose(10.8, 1.8), "kitchen")
    with pytest.raises(NoRouteError, match=r"\(9.00, 4.10, 0.00\).*walls"):
        planner.route(Pose(9.0, 4.1), "kitchen")


def test_what_is_to_be_avoided_is_gone_around(planner):
    assert doors(planner.route("corridor3", "office4", at=NOON)) != []
    by = doors(planner.route("foyer-3rd", "office4"))
    assert by == ["door5", "door6"]
    assert doors(planner.route("foyer-3rd", "office4", avoid=["door6"])) == ["door5", "door7"]
    with pytest.raises(NoRouteError, match="corridor3 is to be avoided"):
        planner.route("foyer-3rd", "office4", avoid=["corridor3"])
    with pytest.raises(NoRouteError, match="corridor1 is to be avoided"):
        planner.route("lab1", "kitchen", avoid=["corridor"])
    assert doors(planner.route("foyer-3rd", "office4")) == by
    with pytest.raises(UnknownPlaceError, match=r"no place named doo6; did you mean door6"):
        planner.route("foyer-3rd", "office4", avoid=["doo6"])
    with pytest.raises(NoRouteError, match=r"edoor[13] is to be avoided"):
        planner.route("lab1", "lab2", avoid=["elevator_door"])


def test_alternatives_come_the_best_first(planner):
    found = planner.alternatives("foyer-3rd", "office4", 4)
    assert [doors(r) for r in found[:2]] == [["door5", "door6"], ["door5", "door7"]]
    assert [r.seconds for r in found] == sorted(r.seconds for r in found)
    with pytest.raises(ValueError, match="k is 0; ask for 1 route or more"):
        planner.alternatives("foyer-3rd", "office4", 0)


def test_names_that_are_not_known(planner):
    with pytest.raises(UnknownPlaceError, match="no place named ofice4; did you mean office4"):
        planner.route("lab1", "ofice4")
    for said, meant in (
        ("muffn", "muffin or muffin1"),
        ("kitchn", "kitchen"),
        ("hoem", "home"),
        ("%", "lists the names"),
        ("", "there are|lists the names"),
        ("a\\", "did you mean|there"),
    ):
        with pytest.raises(UnknownPlaceError, match=meant):
            planner.route("lab1", said)
    with pytest.raises(ValueError, match="lab may be lab1, lab2; name one of them"):
        planner.route("lab", "office4")


def test_what_stands_outside_is_in_no_room():
    tree = LocatedEntity("tree", "object", None, Pose(50.0, 50.0))
    planner = RoutePlanner(RoutingGraph(office()), lookup=Lookup({"tree": [tree]}))
    with pytest.raises(NoRouteError, match="no room holds tree"):
        planner.route("lab1", "tree")
    with pytest.raises(NoRouteError, match="no room holds tree"):
        planner.route("lab1", tree)


def test_an_agent_is_where_its_pose_is():
    agent = LocatedEntity("robot1", "agent", None, Pose(1.0, 1.0))
    planner = RoutePlanner(RoutingGraph(office()), lookup=Lookup({"robot1": [agent]}, "lab1"))
    assert planner.route("robot1", "corridor1").start == "lab1"


def test_rules_have_hours():
    topology = office()
    topology.places["corridor1"] = replace(topology.places["corridor1"], types=("ward",))
    detour = PlaceConnector("detour", ("lab1", "foyer-1st"), (Pose(2.0, 1.0), Pose(90.0, 1.0)))
    topology.connectors["detour"] = detour
    planner = RoutePlanner(RoutingGraph(topology))
    for moment, by in ((NOON, ["door1", "door2"]), (NIGHT, ["detour"]), (None, ["door1", "door2"])):
        assert doors(planner.route("lab1", "foyer-1st", at=moment)) == by
    forbidden = CostRules.parse("rules: [{name: corridor1, forbid: true}]", "mine.yaml")
    assert doors(
        RoutePlanner(RoutingGraph(topology), rules=forbidden).route("lab1", "foyer-1st")
    ) == ["detour"]


def test_reasons_are_those_of_the_map():
    def why(robot=None, **changed):
        with pytest.raises(NoRouteError) as said:
            RoutePlanner(RoutingGraph(office(**changed), robot)).route("lab1", "lab2")
        return str(said.value)

    assert why(door5={"state": "locked"}).endswith("lab1 to lab2: door5 is locked")
    tall = replace(ROBOT.parts[0], name="arm", interval=(0.5, 1.4))
    robot = RobotClass("tall", (tall,))
    assert why(robot, edoor1={"height": 1.2}).endswith(
        "the arm does not fit under edoor1: it reaches to 1.40 m, the opening to 1.20 m"
    )
    assert why(robot, edoor1={"width": 0.3}).endswith(
        "the arm does not fit through edoor1: it is 0.40 m wide, the opening 0.30 m"
    )
    assert why(robot, door8={"step": 0.1}).endswith("door8 has a step of 0.10 m, tall takes 0.02 m")
    assert why(door8={"permissions": frozenset({"staff", "guest"})}).endswith(
        "door8 needs the permission guest or staff"
    )
    assert why(door1={"state": "locked"}, door8={"state": "locked"}).endswith(
        "door1 is locked; door8 is locked"
    )
    islands = Topology.of(
        [Place(n) for n in "abcd"],
        [
            PlaceConnector("x", ("a", "b"), (Pose(), Pose())),
            PlaceConnector("y", ("c", "d"), (Pose(), Pose())),
        ],
    )
    with pytest.raises(NoRouteError, match="a to d: nothing joins them; add the connector"):
        RoutePlanner(RoutingGraph(islands)).route("a", "d")


def test_a_region_that_is_barred_costs_the_way_around_it():
    band = PlaceRegion("band", shapely.box(1.2, 0.9, 1.8, 3.0), ("left",))
    topology = rooms()
    topology = replace(topology, regions=(band,))
    made = ground(topology=topology)
    planner = RoutePlanner(RoutingGraph(topology, ROBOT, costs=made))
    start = ("left", Pose.planar(0.5, 1.5, 0.0))
    plain = planner.route(start, "right")
    around = planner.route(start, "right", avoid=["band"])
    assert around.seconds > plain.seconds + 0.5
    assert planner.route(start, "right").seconds == plain.seconds
    # from the hatch to the door, a walk between two stands
    plain = planner.route("above", "right")
    around = planner.route("above", "right", avoid=["band"])
    assert around.seconds > plain.seconds + 0.5
    assert around.metres > plain.metres + 0.2
    assert planner.route("above", "right") == plain
    wall = replace(
        topology, regions=(PlaceRegion("band", shapely.box(1.2, -1, 1.8, 4.0), ("left",)),)
    )
    planner = RoutePlanner(RoutingGraph(wall, ROBOT, costs=made))
    with pytest.raises(NoRouteError, match="band is to be avoided, and the path in left leads"):
        planner.route("above", "right", avoid=["band"])
    with pytest.raises(NoRouteError, match="the pose is in band, which is to be avoided"):
        planner.route(("left", Pose(1.5, 1.5)), "right", avoid=["band"])
    slow = CostRules.parse("rules: [{name: band, seconds: 1000}]", "mine.yaml")
    planner.rules = slow
    assert planner.route("above", "right").seconds == pytest.approx(plain.seconds)
