"""Sensors of real robots: read from their URDFs, stored with the robots, and asked for."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path

import pytest

from semmap import Map
from semmap.manipulation.automata import register_robot
from semmap.manipulation.reader import list_automata
from semmap.manipulation.sensors import read_sensors
from tests.command_line import semmap
from tests.manipulation.grippers import urdf
from tests.robot.robots import installed_file

STRETCH = "stretch_urdf/RE2V0/stretch_description_RE2V0_tool_stretch_gripper.urdf"


def stretch() -> Path:
    return installed_file("hello-robot-stretch-urdf", STRETCH)


def test_sensors_that_simulators_simulate() -> None:
    """Each element of the PR2's file by its kind, found as text; the IMU is a link alone."""
    text = urdf("pr2").read_text()
    simulated = Counter(re.findall(r"<sensor:(\w+) ", text))
    found = read_sensors(text)
    kinds = Counter(sensor.kind for sensor in found)
    assert kinds["laser"] == simulated["ray"] == 2
    assert kinds["contact"] == simulated["contact"]
    assert kinds["camera"] == simulated["camera"] == 7
    assert found[0].kind == "camera"
    tiago = {s.name: (s.kind, s.link) for s in read_sensors(urdf("tiago").read_text())}
    assert tiago["xtion"] == ("depth camera", "xtion_rgb_frame")
    assert tiago["base_imu"] == ("inertial", "base_imu_link")
    assert tiago["wrist_ft"] == ("force", "wrist_ft_link")


def test_sensors_that_only_links_tell() -> None:
    """The file of the Stretch has no simulated sensor: cameras are where optical frames are."""
    text = stretch().read_text()
    assert "<sensor" not in text
    kinds = {sensor.name: sensor.kind for sensor in read_sensors(text)}
    assert kinds["camera_depth"] == "depth camera"
    assert kinds["camera_color"] == "camera"
    assert kinds["laser"] == "laser"
    assert kinds["base_imu"] == kinds["camera_gyro"] == "inertial"
    optical = set(re.findall(r'link name="(\w+)_optical_frame"', text))
    assert {"camera_depth", "camera_color", "camera_infra1"} <= set(kinds) & optical
    assert read_sensors(urdf("panda").read_text()) == []


def test_robots_are_stored_with_their_sensors_and_asked_for_by_what_they_can(
    cups: Map,
) -> None:
    here = cups.connection
    for name, path in (("tiago", urdf("tiago")), ("stretch", stretch()), ("panda", urdf("panda"))):
        register_robot(here, path, name)
    robots = {row["name"]: row for row in list_automata(here)}
    assert robots["tiago"]["sensor"] == "tiago/xtion"
    assert robots["stretch"]["sensor"] == "stretch/camera_depth"
    assert robots["panda"]["sensor"] is None
    assert {"gripping", "reaching", "seeing", "feeling"} <= set(robots["tiago"]["capabilities"])

    def able(*words: str) -> list[str]:
        return [row["name"] for row in list_automata(here, words)]

    assert able("grasp") == ["panda", "stretch", "tiago"]
    assert able("grasp", "see") == able("sensing") == able("sense") == ["stretch", "tiago"]
    assert able("feel") == ["tiago"]
    with pytest.raises(LookupError, match="no capability flying"):
        able("flying")
    register_robot(here, urdf("tiago"), "tiago")  # again: the same devices
    assert {row["name"]: row for row in list_automata(here)} == robots


def test_the_command(cup_map: Map) -> None:
    url = cup_map.database.engine.url.render_as_string(hide_password=False)
    stored = semmap(url, "manipulation", "add-robot", stretch(), "--name", "stretch")
    assert stored.exit_code == 0, stored.output
    told = semmap(url, "manipulation", "robots", "--can", "push", "--can", "see", "--json")
    (row,) = json.loads(told.stdout)
    assert row["sensors"][0] == "stretch/camera_depth"
    assert "stretch_gripper" in semmap(url, "manipulation", "robots").stdout
    assert json.loads(semmap(url, "manipulation", "robots", "--can", "feel", "--json").stdout) == []
