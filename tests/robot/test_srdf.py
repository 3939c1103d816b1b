"""Named joint states, beside a URDF or in the folder `srdf`, as robots in the wild have them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semmap.robot import Part, load_robot, robot_parts
from semmap.robot.error import RobotError
from semmap.robot.joint_positions import joints_of, read_states
from tests.robot.robots import by_hand

SRDF = """<robot name="by_hand">
  <group_state name="folded" group="arm"><joint name="shoulder" value="1.5"/></group_state>
  <group_state name="folded" group="lift"><joint name="lift" value="0.1"/></group_state>
  <group_state name="stretched" group="arm"><joint name="shoulder" value="0"/></group_state>
</robot>"""


def _parts(urdf: Path, state: str) -> list[Part]:
    return robot_parts(load_robot(urdf), joints_of(urdf, state))


@pytest.mark.parametrize("folder", ["robot/urdf", "robot/srdf"])
def test_a_state_by_its_name(tmp_path: Path, folder: str) -> None:
    (tmp_path / "robot" / "urdf").mkdir(parents=True)
    (tmp_path / folder).mkdir(exist_ok=True)
    urdf = by_hand(tmp_path / "robot" / "urdf")
    (tmp_path / folder / "by_hand.srdf").write_text(SRDF)
    assert joints_of(urdf, "folded") == {"shoulder": 1.5, "lift": 0.1}
    by_name, by_joints = (
        _parts(urdf, state) for state in ("folded", '{"shoulder": 1.5, "lift": 0.1}')
    )
    assert [p.interval for p in by_name] == [p.interval for p in by_joints]
    assert max(np.ptp(p.footprint[:, 1]) for p in by_name) > 0.7  # the arm points to the left
    assert max(np.ptp(p.footprint[:, 1]) for p in _parts(urdf, "stretched")) < 0.6
    with pytest.raises(ValueError, match="the SRDF has folded, stretched"):
        joints_of(urdf, "tucked")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot><group_state", "is not well-formed XML"),
        (SRDF.replace("1.5", "far"), "joint shoulder: its value 'far' is not a number"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "by_hand.srdf").write_text(text)
    with pytest.raises(RobotError, match=message):
        read_states(by_hand(tmp_path))
