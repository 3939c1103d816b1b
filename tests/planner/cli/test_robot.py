"""`semmap robot` and `semmap route --robot` on the office."""

import json

import pytest
import typer
from sqlalchemy import text

from planner.readers.robot_class import read_robot_class
from tests.office import OFFICE
from tests.seen import seen_by

URDF = OFFICE / "delivery_robot.urdf"


@pytest.fixture
def robots(commands, office_engine):
    yield commands
    with office_engine.begin() as connection:
        connection.execute(text("DELETE FROM robot_class"))


def test_a_class_is_added_listed_replaced_and_forgotten(robots, office_engine):
    assert json.loads(robots.run("robot", "ls", "--json").stdout) == []
    more = (
        "--reach",
        "0.3,0.9",
        "--heights",
        "0.1,1.4",
        "--capacity",
        2,
        "--behaviour",
        "pass_door",
        "--permission",
        "staff",
        "--no-opens",
        "--max-slope",
        3,
    )
    said = json.loads(robots.run("robot", "add", "porter", "--robot", URDF, *more, "--json").stdout)
    assert json.loads(robots.run("robot", "ls", "--json").stdout) == said
    (row,) = said
    assert (row["name"], row["reach"], row["capacity"]) == ("porter", [0.3, 0.9], 2)
    assert (row["behaviours"], row["permissions"]) == (["pass_door"], ["staff"])
    assert {"base", "arm"} <= set(row["parts"])
    with office_engine.connect() as connection:
        number, robot, *_ = read_robot_class(seen_by(connection), "porter")
    assert (robot.opens, robot.unlocks, robot.heights) == (False, False, (0.1, 1.4))
    assert robot.drive_limits.max_slope == pytest.approx(0.05236, abs=1e-5)
    robots.run("robot", "add", "porter", "--robot", URDF, "--speed", 1.0)
    with office_engine.connect() as connection:
        again, robot, *_ = read_robot_class(seen_by(connection), "porter")
    assert (again, robot.speed, robot.opens) == (number, 1.0, True)
    shown = robots.run("robot", "ls").stdout
    assert "porter" in shown
    assert "arm 0.89 to 0.97 m" in shown
    robots.run("robot", "rm", "porter")
    assert json.loads(robots.run("robot", "ls", "--json").stdout) == []


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--speed", 0), "porter: its speed is 0.0 m/s; give one above 0"),
        (("--speed", "inf"), "give one above 0"),
        (("--capacity", 0), "porter: its capacity is 0 objects; give 1"),
        (("--reach", "0.9,0.3"), "porter: reach is 0.9 to 0.3 m; give the lower end first"),
        (("--heights", "-1,1"), "porter: heights is -1.0 to 1.0 m"),
        (("--reach", "far"), "MIN,MAX"),
        (("--max-step", -1), "a step of -1.0 m .*; give a step of 0 m or more"),
        (("--max-step", 5), "its part base ends at 0.330 m, below a step of 5 m; give a lower"),
        (("--max-slope", 90), "less than a right angle"),
    ],
)
def test_what_is_no_robot_is_refused_and_nothing_kept(robots, more, message):
    with pytest.raises((ValueError, typer.BadParameter), match=message):
        robots.run("robot", "add", "porter", "--robot", URDF, *more)
    assert json.loads(robots.run("robot", "ls", "--json").stdout) == []


def test_a_class_has_a_name(robots):
    with pytest.raises(ValueError, match="the name of a robot class is empty"):
        robots.run("robot", "add", "", "--robot", URDF)


def test_unknown_classes_are_said(robots):
    with pytest.raises(LookupError, match="no robot class named porter; semmap robot add"):
        robots.run("robot", "rm", "porter")
    robots.run("robot", "add", "carrier", "--robot", URDF)
    with pytest.raises(LookupError, match="no robot class named porter; there are: carrier"):
        robots.run("route", "lab1", "office4", "--robot", "porter")


def test_a_route_of_a_class_has_times_maps_and_alternatives(robots):
    robots.run("robot", "add", "porter", "--robot", URDF, "--speed", 0.8)
    said = json.loads(
        robots.run("route", "lab1", "muffin1", "--robot", "porter", "-k", 2, "--json").stdout
    )
    steps = said["steps"]
    assert sum(s["seconds"] for s in steps) == pytest.approx(said["seconds"])
    assert {s["map"] for s in steps} == {"floor-1st/master.yaml", "floor-3rd/master.yaml"}
    switch = next(s for s in steps if s["behaviour"] == "switch_map")
    assert (switch["map"], switch["frame"]) == ("floor-3rd/master.yaml", steps[-1]["frame"])
    assert [d["name"] for d in said["alternatives"][0]["doors"]][-1] == "door7"
    shown = robots.run("route", "lab1", "office4", "--robot", "porter").stdout
    assert "door1, door2, edoor1, edoor3, door5, door6" in shown
    assert "use_elevator" in shown
    locked = robots.run(
        "route", "lab1", "office5", "--robot", "porter", "--locked", "--rooms"
    ).stdout
    assert locked.strip().split(",")[-2:] == ["corridor3", "office5"]
