"""A simulated world is made of the map once, and opened again as it was left."""

import pytest

from planner.live import Live
from planner.mission.failures import FailureRule
from planner.mission.journal import MissionError
from planner.mission.simulation import entry, open_world, simulated_robot
from planner.robot_class import RobotClass
from planner.source.robot_class import delete_robot_class, keep_robot_class
from planner.topology import Place, Topology
from semmap.geometry.pose import Pose
from tests.planner.mission.conftest import START
from tests.planner.office import office


def test_a_robot_enters_before_the_first_door_of_a_place():
    pose = entry(office(), "lab1")
    assert (pose.x, pose.y) == pytest.approx((2.0, 3.3))
    with pytest.raises(MissionError, match="cell has no door"):
        entry(Topology.of([Place("cell")], []), "cell")


def test_the_world_is_as_the_map_and_stays_as_it_was_left(world, tmp_path):
    file = tmp_path / "worlds" / "truth"
    rules = [FailureRule.parse("door5 locked")]
    with world.journal() as journal:
        truth = open_world(file, journal, world.topology, "robot", rules)
        assert truth.robot("robot") == ("lab1", START)
        assert truth.door("door5") == "locked"
        assert truth.door("door1") == "open"
        assert {t.name: t.place for t in journal.things()} == {
            name: place for name, (place, _) in truth.things().items()
        }
        truth.put_robot("robot", "foyer-1st", Pose.planar(3.0, 5.0))
        truth.close()
        again = open_world(file, journal, world.topology, "robot", resume=True)
        assert again.robot("robot") == ("foyer-1st", Pose.planar(3.0, 5.0))
        assert again.door("door5") == "locked"
        again.close()


def test_what_cannot_be_opened_leaves_no_file(world, tmp_path):
    file = tmp_path / "another"
    with world.journal() as journal:
        with pytest.raises(MissionError, match="is gone: name its --world"):
            open_world(file, journal, world.topology, "robot", resume=True)
        with pytest.raises(MissionError, match=r"no room holds stranger: .*--from"):
            open_world(file, journal, world.topology, "stranger")
        assert not file.exists()
        open_world(file, journal, world.topology, "robot").close()
        with pytest.raises(MissionError, match="no room holds stranger"):
            open_world(
                file, journal, world.topology, "stranger", [FailureRule.parse("door1 locked")]
            )
        truth = open_world(file, journal, world.topology, "robot")
        assert truth.door("door1") == "open"  # the stranger's rules were not taken in
        truth.close()


def test_a_simulated_robot_is_as_fast_as_its_class(world):
    with world.engine.begin() as connection:
        keep_robot_class(connection, RobotClass("crawler", speed=0.25))
    try:
        live = Live(world.engine, "office", "crawler")
        robot = simulated_robot(live, world.truth, "robot", speed=60.0, seed=3)
        assert (robot._velocity, robot.speed, robot.name) == (0.25, 60.0, "robot")
    finally:
        with world.engine.begin() as connection:
            delete_robot_class(connection, "crawler")
