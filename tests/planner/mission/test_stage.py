"""Stages as the journal keeps them."""

import json

import pytest

from planner.mission.stage import Stage
from planner.route import Step
from planner.topology import Connector
from semmap.geometry.pose import Pose

DOOR = Connector(
    "door1", ("a", "b"), (Pose(-0.5), Pose.planar(0.5, 0.0, 3.0)), permissions=frozenset({"staff"})
)
STAGES = [
    Stage("pass_door", ("door1", "a", "b"),
          Step("pass_door", "a", "b", DOOR, None, Pose(-0.5), Pose(0.5), 1.0, 1.0), seconds=1.0),
    Stage("navigate", ("a",), Step("navigate", "a", "a", None, None, None, Pose(2.0))),
    Stage("place", ("muffin1", "desk1"), at=Pose(1.0, 2.0), spot=Pose(z=0.7), seconds=10.0),
]  # fmt: skip


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_is_what_the_journal_read(stage):
    assert Stage.of_json(json.loads(json.dumps(stage.as_json()))) == stage


@pytest.mark.parametrize("stage", STAGES)
def test_poses_may_be_objects_as_they_once_were(stage):
    def named(said):
        if isinstance(said, list) and len(said) == 7:
            return Pose(*said)._asdict()
        if isinstance(said, dict):
            return {key: named(value) for key, value in said.items()}
        return [named(s) for s in said] if isinstance(said, list) else said

    said = named(json.loads(json.dumps(stage.as_json())))
    assert Stage.of_json(said) == stage
