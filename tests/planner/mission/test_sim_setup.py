"""A simulated world is made of the map once, and opened again as it was left."""

import numpy as np
import pytest
import shapely

import semmap
from planner.live_topology import LiveTopology
from planner.mission.failures import FailureRule
from planner.mission.sim_setup import entry_poses, open_world, simulated_robot
from planner.mission.store.mission_list import MissionError
from planner.readers.robot_class import delete_robot_class, store_robot_class
from planner.robot_class import RobotClass
from planner.routing_graph import RoutingGraph
from planner.topology import Place, Topology
from semmap.geometry.pose import Pose
from semmap.query.map_handle import MapHandle
from semmap.robot import Part
from tests.planner.mission.conftest import START
from tests.planner.office import office


def test_a_robot_enters_before_the_first_door_from_which_it_gets_anywhere():
    graph = RoutingGraph(office())
    pose = entry_poses(graph, "lab1")[0]
    assert (pose.x, pose.y) == pytest.approx((2.0, 3.3))
    first, second, *_ = graph.nodes["foyer-1st"]
    assert entry_poses(graph, "foyer-1st")[0] == graph.poses[first]
    graph.seconds[graph.tails == first] = np.inf  # a chair stands before that door
    assert entry_poses(graph, "foyer-1st")[0] == graph.poses[second]
    assert len(entry_poses(graph, "foyer-1st")) == 2  # the part beyond the chair, and the others
    graph.seconds[graph.travel_edges["foyer-1st"]] = np.inf
    assert len(entry_poses(graph, "foyer-1st")) == len(graph.nodes["foyer-1st"])
    with pytest.raises(MissionError, match="cell has no door"):
        entry_poses(RoutingGraph(Topology.of([Place("cell")], [])), "cell")


@pytest.mark.parametrize(("side", "passes"), [(0.7, True), (0.2, False)])
def test_a_robot_begins_in_no_obstacle_before_a_door(make_database, side: float, passes: bool):
    """A crate stands where the robot would, and leaves it a gap beside it, or none."""
    corners = shapely.get_coordinates(shapely.Point(0, 0).buffer(0.2).exterior)[:0:-1]
    disc = RobotClass("disc", (Part("base", ("base",), (0.05, 1.0), corners, 0.199, 0.2),))
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        house = db.create_map("house")
        house.add_room("a", [(0, 0), (4, 0), (4, 4), (0, 4)], floor=0, ceiling=2.5)
        house.add_room("b", [(4.1, 0), (8, 0), (8, 4), (4.1, 4)], floor=0, ceiling=2.5)
        wide = 0.4 + 2 * side
        house.add_door("ab", "a", "b", line=((4.05, 2 - wide / 2), (4.05, 2 + wide / 2)))
        house.add_object("crate", type="box", size=(1.0, 0.4, 0.8), pose=(3.7, 2, 0))
        crate = house["crate"].footprint
        live = LiveTopology(house, disc)
        (pose,) = entry_poses(live.graph, "a")
        assert shapely.Point(pose.x, pose.y).distance(crate) > 0.199
        if passes:
            assert pose == live.graph.standing(0)


def test_the_world_is_as_the_map_and_stays_as_it_was_left(world, tmp_path):
    file = tmp_path / "worlds" / "world"
    rules = [FailureRule.parse("door5 locked")]
    with world.store() as store:
        own = open_world(file, store, world.topology, "robot", rules)
        assert own.robot("robot") == ("lab1", START)
        assert own.door("door5") == "locked"
        assert own.door("door1") == "open"
        assert {t.name: t.place for t in store.objects()} == {
            name: place for name, (place, _) in own.objects().items()
        }
        own.put_robot("robot", "foyer-1st", Pose.planar(3.0, 5.0))
        own.close()
        again = open_world(file, store, world.topology, "robot", resume=True)
        assert again.robot("robot") == ("foyer-1st", Pose.planar(3.0, 5.0))
        assert again.door("door5") == "locked"
        again.close()


def test_what_cannot_be_opened_leaves_no_file(world, tmp_path):
    file = tmp_path / "another"
    with world.store() as store:
        with pytest.raises(MissionError, match="is gone: name its file by world="):
            open_world(file, store, world.topology, "robot", resume=True)
        with pytest.raises(MissionError, match=r"no room holds stranger: .*start="):
            open_world(file, store, world.topology, "stranger")
        assert not file.exists()
        open_world(file, store, world.topology, "robot").close()
        with pytest.raises(MissionError, match="no room holds stranger"):
            open_world(file, store, world.topology, "stranger", [FailureRule.parse("door1 locked")])
        own = open_world(file, store, world.topology, "robot")
        assert own.door("door1") == "open"  # the stranger's rules were not taken in
        own.close()


def test_a_lift_stands_where_a_robot_is_in_it_and_lets_it_out(world, tmp_path):
    graph = RoutingGraph(world.topology)
    with world.store() as store:
        store.add_robot("rider", "elevator-3rd", entry_poses(graph, "elevator-3rd")[0])
        own = open_world(tmp_path / "ride", store, world.topology, "rider")
        assert own.elevator("elevator") == ("elevator-3rd", "rider")
        own.close()


def test_a_simulated_robot_is_as_fast_as_its_class(world):
    with world.engine.begin() as connection:
        store_robot_class(connection, RobotClass("crawler", speed=0.25))
    try:
        live = LiveTopology(MapHandle(world.engine, "office"), "crawler")
        robot = simulated_robot(live, world.world, "robot", speed=60.0, seed=3)
        assert (robot.velocity, robot.speed, robot.name) == (0.25, 60.0, "robot")
    finally:
        with world.engine.begin() as connection:
            delete_robot_class(connection, "crawler")
