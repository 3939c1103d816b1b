"""Questions as people ask them, on the office and on plain topologies."""

import math
from contextlib import suppress
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest
import shapely

from planner.ask import Asker
from planner.network import Network
from planner.robot_class import RobotClass
from planner.route import NoRouteError
from planner.rules import Rules
from planner.target import Target
from planner.topology import Connector, Place, Region, Topology, UnknownPlaceError
from semmap.geometry.pose import Pose
from tests.planner.office import office
from tests.planner.test_ground import ROBOT, ground, rooms

NOON, NIGHT = datetime(2024, 5, 5, 12), datetime(2024, 5, 5, 23)


def doors(route):
    return [s.connector.name for s in route.doors]


@pytest.fixture
def asker(office_live):
    made = office_live.asker()
    made.rng = np.random.default_rng(7)
    return made


def test_to_a_thing_means_to_a_pose_from_which_it_is_reached(asker):
    route = asker.route("lab1", "muffin1")[0]
    assert route.goal == "office4"
    end = route.stages[-1].leave
    (muffin,) = asker.look_up("muffin1")
    away = shapely.Point(end.x, end.y).distance(muffin.footprint)
    assert 0.2 <= away <= 0.8
    facing = math.atan2(muffin.pose.y - end.y, muffin.pose.x - end.x)
    assert math.cos(end.yaw - facing) > 0.99
    assert end.z == pytest.approx(7.0)


def test_of_a_type_the_nearest_is_meant(asker):
    for start in ("foyer-1st", "foyer-3rd", "office4", "meeting1"):
        nearest = min(
            (r for n in ("meeting1", "meeting3") for r in asker.route(start, n)),
            key=lambda r: r.seconds,
        )
        found = asker.route(start, "meeting_room")[0]
        assert (found.goal, found.seconds) == (nearest.goal, pytest.approx(nearest.seconds))
    assert asker.route("lab1", "kitchen")[0].goal == "kitchen"
    one = asker.route("kitchen", "potted_plant")[0]
    all_of = []
    for plant in asker.look_up("potted_plant"):
        with suppress(NoRouteError):  # one stands behind the conference table
            all_of.append(asker.route("kitchen", plant)[0].seconds)
    assert one.seconds == pytest.approx(min(all_of))
    assert len(all_of) > 3


def test_home_is_a_region_from_which_a_pose_is_drawn(asker):
    (home,) = asker.look_up("home")
    ends = set()
    for _ in range(5):
        route = asker.route("office4", "home")[0]
        assert route.goal == "lab1"
        end = route.stages[-1].leave
        assert home.footprint.covers(shapely.Point(end.x, end.y))
        ends.add((end.x, end.y))
    assert len(ends) > 1


def test_poses_are_starts_and_goals(asker):
    route = asker.route(Pose(8.0, 5.2, 0.0), Pose(8.0, 5.0, 7.0))[0]
    assert (route.start, route.goal) == ("corridor1", "corridor3")
    assert route.stages[0].approach == Pose(8.0, 5.2, 0.0)
    assert route.stages[-1].leave == Pose(8.0, 5.0, 7.0)
    assert math.fsum(s.seconds for s in route.stages) == pytest.approx(route.seconds)
    with pytest.raises(NoRouteError, match=r"\(80.00, 5.20, 0.00\) is in no room"):
        asker.route(Pose(80.0, 5.2), "lab1")


def test_a_start_inside_a_wall_names_the_wall(asker):
    with pytest.raises(
        NoRouteError, match=r"tester cannot stand at .* in lab1: bookshelf1.* is in"
    ):
        asker.route(Pose(10.8, 1.8), "kitchen")
    with pytest.raises(NoRouteError, match=r"\(9.00, 4.10, 0.00\).*walls"):
        asker.route(Pose(9.0, 4.1), "kitchen")


def test_what_is_to_be_avoided_is_gone_around(asker):
    assert doors(asker.route("corridor3", "office4", at=NOON)[0]) != []
    by = doors(asker.route("foyer-3rd", "office4")[0])
    assert by == ["door5", "door6"]
    assert doors(asker.route("foyer-3rd", "office4", avoid=["door6"])[0]) == ["door5", "door7"]
    with pytest.raises(NoRouteError, match="corridor3 is to be avoided"):
        asker.route("foyer-3rd", "office4", avoid=["corridor3"])
    with pytest.raises(NoRouteError, match="corridor1 is to be avoided"):
        asker.route("lab1", "kitchen", avoid=["corridor"])
    assert doors(asker.route("foyer-3rd", "office4")[0]) == by
    with pytest.raises(UnknownPlaceError, match=r"no place named doo6; did you mean door6"):
        asker.route("foyer-3rd", "office4", avoid=["doo6"])
    with pytest.raises(NoRouteError, match=r"edoor[13] is to be avoided"):
        asker.route("lab1", "lab2", avoid=["elevator_door"])


def test_alternatives_come_the_best_first(asker):
    found = asker.route("foyer-3rd", "office4", k=4)
    assert [doors(r) for r in found[:2]] == [["door5", "door6"], ["door5", "door7"]]
    assert [r.seconds for r in found] == sorted(r.seconds for r in found)
    with pytest.raises(ValueError, match="ask for 1 route or more, not 0"):
        asker.route("foyer-3rd", "office4", k=0)


def test_names_that_are_not_known(asker):
    with pytest.raises(UnknownPlaceError, match="no place named ofice4; did you mean office4"):
        asker.route("lab1", "ofice4")
    for said, meant in (("muffn", "muffin or muffin1"), ("kitchn", "kitchen"),
                        ("hoem", "home"),
                        ("%", "there are"), ("", "there are"),
                        ("a\\", "did you mean|there")):  # fmt: skip
        with pytest.raises(UnknownPlaceError, match=meant):
            asker.route("lab1", said)
    with pytest.raises(ValueError, match="lab may be lab1, lab2; name one of them"):
        asker.route("lab", "office4")


def test_what_stands_outside_is_in_no_room():
    tree = Target("tree", "object", None, Pose(50.0, 50.0))
    asked = Asker(Network(office()), lambda said: [tree] if said == "tree" else [])
    with pytest.raises(NoRouteError, match="no room holds tree"):
        asked.route("lab1", "tree")
    with pytest.raises(NoRouteError, match="no room holds tree"):
        asked.route("lab1", tree)


def test_an_agent_is_where_its_pose_is():
    agent = Target("robot1", "agent", None, Pose(1.0, 1.0))
    asked = Asker(Network(office()), lambda said: [agent], lambda pose: "lab1")
    assert asked.route("robot1", "corridor1")[0].start == "lab1"


def test_rules_have_hours():
    topology = office()
    topology.places["corridor1"] = replace(topology.places["corridor1"], types=("ward",))
    detour = Connector("detour", ("lab1", "foyer-1st"), (Pose(2.0, 1.0), Pose(90.0, 1.0)))
    topology.connectors["detour"] = detour
    asked = Asker(Network(topology))
    for moment, by in ((NOON, ["door1", "door2"]), (NIGHT, ["detour"]), (None, ["door1", "door2"])):
        assert doors(asked.route("lab1", "foyer-1st", at=moment)[0]) == by
    forbidden = Rules.parse("rules: [{name: corridor1, forbid: true}]", "mine.yaml")
    assert doors(Asker(Network(topology), rules=forbidden).route("lab1", "foyer-1st")[0]) == [
        "detour"
    ]


def test_reasons_are_those_of_the_map():
    def why(robot=None, **changed):
        with pytest.raises(NoRouteError) as said:
            Asker(Network(office(**changed), robot)).route("lab1", "lab2")
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
            Connector("x", ("a", "b"), (Pose(), Pose())),
            Connector("y", ("c", "d"), (Pose(), Pose())),
        ],
    )
    with pytest.raises(NoRouteError, match="a to d: nothing joins them; add the connector"):
        Asker(Network(islands)).route("a", "d")


def test_a_region_that_is_barred_costs_the_way_around_it():
    band = Region("band", shapely.box(1.2, 0.9, 1.8, 3.0), ("left",))
    topology = rooms()
    topology = replace(topology, regions=(band,))
    made = ground(topology=topology)
    asked = Asker(Network(topology, ROBOT, walks=made), ground=made)
    start = ("left", Pose.planar(0.5, 1.5, 0.0))
    plain = asked.route(start, "right")[0]
    around = asked.route(start, "right", avoid=["band"])[0]
    assert around.seconds > plain.seconds + 0.5
    assert asked.route(start, "right")[0].seconds == plain.seconds
    # from the hatch to the door, a walk between two stands
    plain = asked.route("above", "right")[0]
    around = asked.route("above", "right", avoid=["band"])[0]
    assert around.seconds > plain.seconds + 0.5
    assert around.metres > plain.metres + 0.2
    assert asked.route("above", "right")[0] == plain
    wall = replace(topology, regions=(Region("band", shapely.box(1.2, -1, 1.8, 4.0), ("left",)),))
    asked = Asker(Network(wall, ROBOT, walks=made), ground=made)
    with pytest.raises(NoRouteError, match="band is to be avoided, and the way in left leads"):
        asked.route("above", "right", avoid=["band"])
    with pytest.raises(NoRouteError, match="it is in band, which is to be avoided"):
        asked.route(("left", Pose(1.5, 1.5)), "right", avoid=["band"])
    slow = Rules.parse("rules: [{name: band, seconds: 1000}]", "mine.yaml")
    asked.rules = slow
    assert asked.route("above", "right")[0].seconds == pytest.approx(plain.seconds)
