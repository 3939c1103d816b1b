"""Stages as the store keeps them."""

import json

import pytest

from planner.mission.command import Command
from planner.route import RouteStep
from planner.topology import PlaceConnector
from semmap.geometry.pose import Pose

DOOR = PlaceConnector(
    "door1", ("a", "b"), (Pose(-0.5), Pose.planar(0.5, 0.0, 3.0)), permissions=frozenset({"staff"})
)
STAGES = [
    Command(
        "pass_door",
        ("door1", "a", "b"),
        RouteStep("pass_door", "a", "b", DOOR, None, Pose(-0.5), Pose(0.5), 1.0, 1.0),
        seconds=1.0,
    ),
    Command(
        "pass_door",
        ("door1", "a", "b"),
        RouteStep(
            "pass_door", "a", "b", DOOR, None, Pose(-0.5), Pose(0.5), 1.0, 1.2, bends=((0.0, 0.3),)
        ),
    ),
    Command("navigate", ("a",), RouteStep("navigate", "a", "a", None, None, None, Pose(2.0))),
    Command("place", ("muffin1", "desk1"), at=Pose(1.0, 2.0), spot=Pose(z=0.7), seconds=10.0),
]


@pytest.mark.parametrize("command", STAGES)
def test_a_stage_is_what_the_journal_read(command):
    assert Command.of_json(json.loads(json.dumps(command.as_json()))) == command


@pytest.mark.parametrize("command", STAGES)
def test_poses_may_be_objects_as_they_once_were(command):
    def named(said):
        if isinstance(said, list) and len(said) == 7:
            return Pose(*said)._asdict()
        if isinstance(said, dict):
            return {key: named(value) for key, value in said.items()}
        return [named(s) for s in said] if isinstance(said, list) else said

    said = named(json.loads(json.dumps(command.as_json())))
    assert Command.of_json(said) == command
