"""The Python that has rclpy: of `SEMMAP_ROS_PYTHON`, of `scripts/setup test`, or this one."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

_MADE = Path(sys.prefix) / "ros/bin/python"
_KNOWN = str(_MADE) if _MADE.exists() else sys.executable if find_spec("rclpy") else ""

ROS_PYTHON = os.environ.get("SEMMAP_ROS_PYTHON") or _KNOWN
"""Its path; "" where there is none."""

WHY_NOT = "no rclpy: scripts/setup test installs it, SEMMAP_ROS_PYTHON names another Python"
