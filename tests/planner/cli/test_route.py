import json
import math

import numpy as np
import pytest

from navgrid.map_file import read_map
from planner.route import NoRouteError
from planner.topology import UnknownPlaceError
from semmap.cli.route import readable_pose
from semmap.geometry.pose import Pose


def test_route_names_the_doors_in_order_each_with_two_poses(commands):
    said = json.loads(commands.run("route", "lab1", "office4", "--json").stdout)
    names = [door["name"] for door in said["doors"]]
    assert names == ["door1", "door2", "edoor1", "edoor3", "door5", "door6"]
    first = said["doors"][0]
    assert (first["from"], first["to"]) == ("lab1", "corridor1")
    for pose in (first["approach"], first["leave"]):
        assert set(pose) == {"x", "y", "z", "qx", "qy", "qz", "qw"}
        # door1 leads north: both poses look along +y
        assert 2 * (pose["qx"] * pose["qy"] + pose["qz"] * pose["qw"]) == pytest.approx(1.0)
    assert first["approach"]["y"] < first["leave"]["y"]
    assert [s["behaviour"] for s in said["transitions"]].count("use_elevator") == 1


def test_route_as_a_table_ends_with_the_doors(commands):
    said = commands.run("route", "lab1", "office4").stdout
    assert "call_elevator" in said
    assert "lab1 -> office4: door1, door2, edoor1, edoor3, door5, door6 (" in said


def test_headings_are_above_minus_180_degrees():
    for yaw, said in ((-math.pi, "180°"), (math.pi, "180°"), (-1e-9, "0°"), (-math.pi / 2, "-90°")):
        assert readable_pose(Pose.planar(1.0, 2.0, yaw)) == f"1.00 2.00 0.00; {said}"


def test_route_takes_things_and_labels(commands):
    said = json.loads(commands.run("route", "desk2", "muffin1", "--json").stdout)
    assert (said["from"], said["to"]) == ("lab1", "office4")
    assert json.loads(commands.run("route", "lab1", "kitchen", "--json").stdout)["to"] == "kitchen"


def test_route_says_what_is_wrong(commands):
    with pytest.raises(UnknownPlaceError, match="no place named offfice4; did you mean office4"):
        commands.run("route", "lab1", "offfice4")
    with pytest.raises(ValueError, match="lab may be lab1, lab2; name one"):
        commands.run("route", "lab", "office4")
    with pytest.raises(NoRouteError, match="door13 is locked"):
        commands.run("route", "lab1", "office5")
    assert "door13" in commands.run("route", "lab1", "office5", "--locked").stdout
    with pytest.raises(NoRouteError, match="door10 is closed"):
        commands.run("route", "lab1", "restroom1", "--no-closed")


def test_grid_writes_a_nav2_map_of_each_storey(commands, folder):
    said = json.loads(commands.run("grid", "-o", folder, "--json", "--no-picture").stdout)
    assert [row["storey"] for row in said] == ["floor-1st", "floor-3rd"]
    for row in said:
        grid, cells = read_map(row["map"])
        assert grid.shape == (row["height"], row["width"]) == cells.shape
        assert grid.origin == tuple(row["origin"])
        for name, value in (("occupied", 100), ("free", 0), ("unknown", -1)):
            assert row[name] == np.count_nonzero(cells == value) > 1000
    assert sorted(p.name for p in (folder / "floor-1st").iterdir()) == ["map.pgm", "map.yaml"]

    grid, cells = read_map(folder / "floor-1st" / "map.yaml")

    def at(x, y):
        column, row = ((v - o) / grid.resolution for v, o in zip((x, y), grid.origin, strict=True))
        return int(cells[int(row), int(column)])

    assert at(0.6, 3.2) == 100  # the blocked staircase, where the floor falls away
    assert at(16.1, 3.1) == 0  # home
    assert at(12.93, 4.1) == 0  # through door1, which is open
    assert at(1.03, 7.31) == 100  # door10 is closed


def test_grid_takes_a_storey_an_interval_and_a_resolution(commands, folder):
    arguments = (
        "-o",
        folder,
        "--storey",
        "floor-3rd",
        "--interval",
        "1.0,1.5",
        "--resolution",
        0.1,
    )
    said = json.loads(commands.run("grid", *arguments, "--json").stdout)
    assert len(said) == 1
    assert said[0]["resolution"] == 0.1
    assert {p.name for p in folder.iterdir()} == {"map.yaml", "map.pgm", "plan.png"}
    assert "floor-3rd: " in commands.run("grid", *arguments, "--no-picture").stdout
    with pytest.raises(LookupError, match="no storey named floor-2nd; did you mean floor-"):
        commands.run("grid", "-o", folder, "--storey", "floor-2nd")
