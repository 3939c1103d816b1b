"""Robots of the tests: one by hand, and real ones where their packages are installed."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import pytest

BY_HAND = """<robot name="by_hand">
  <link name="base_footprint"/>
  <link name="base_link"><collision><geometry><box size="0.6 0.4 0.3"/></geometry></collision></link>
  <link name="wheel"><collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision></link>
  <link name="column"><collision><geometry><box size="0.1 0.1 0.8"/></geometry></collision></link>
  <link name="upper"><visual><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.06 0.06"/></geometry></visual></link>
  <link name="lower"><collision><origin xyz="0.15 0 0"/><geometry><box size="0.3 0.04 0.04"/></geometry></collision></link>
  <link name="head_link"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <joint name="ground" type="fixed"><parent link="base_footprint"/><child link="base_link"/><origin xyz="0 0 0.2"/></joint>
  <joint name="roll" type="continuous"><parent link="base_link"/><child link="wheel"/><origin xyz="0 0.25 -0.1" rpy="1.5707963 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="lift" type="prismatic"><parent link="base_link"/><child link="column"/><origin xyz="-0.2 0 0.55"/><axis xyz="0 0 1"/><limit lower="0" upper="0.4" effort="1" velocity="1"/></joint>
  <joint name="shoulder" type="revolute"><parent link="column"/><child link="upper"/><origin xyz="0.05 0 0.2"/><axis xyz="0 0 1"/><limit lower="-1.6" upper="1.6" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/><limit lower="-1.6" upper="1.6" effort="1" velocity="1"/></joint>
  <joint name="pan" type="revolute"><parent link="column"/><child link="head_link"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""  # noqa: E501
"""A base of 0.6 x 0.4 m from z 0.05 to 0.35, a column that lifts, an arm of two boxes, a head."""

REAL = {
    "tiago": ("example-robot-data", "tiago_description/robots/tiago.urdf"),
    "pr2": ("example-robot-data", "pr2_description/urdf/pr2.urdf"),
    "stretch": (
        "hello-robot-stretch-urdf",
        "SE3/stretch_description_SE3_eoa_wrist_dw3_tool_sg3.urdf",
    ),
}


def real_robot(name: str) -> Path:
    """The URDF of a real robot; skips the test where its package is not installed."""
    return installed_file(*REAL[name])


def installed_file(package: str, file: str) -> Path:
    """A file of an installed package; skips the test where the package is not installed."""
    try:
        files = importlib.metadata.files(package) or []
    except importlib.metadata.PackageNotFoundError:
        pytest.skip(f"{package} is not installed")
    return Path(str(next(f.locate() for f in files if str(f).endswith(file))))


def by_hand(folder: Path, text: str = BY_HAND) -> Path:
    """The file of the robot by hand."""
    path = folder / "by_hand.urdf"
    path.write_text(text)
    return path
