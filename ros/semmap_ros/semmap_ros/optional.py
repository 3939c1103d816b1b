"""Messages of packages that PyPI does not have; `scripts/ros_messages` builds them."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def optional_message(name: str) -> Any:
    """Return the class of a message such as ``tf2_msgs/TFMessage``; None without its package."""
    package, own = name.split("/")
    try:
        return getattr(import_module(f"{package}.msg"), own)
    except ModuleNotFoundError:
        return None


TFMessage = optional_message("tf2_msgs/TFMessage")
CostmapFilterInfo = optional_message("nav2_msgs/CostmapFilterInfo")
Detection3DArray = optional_message("vision_msgs/Detection3DArray")
LabelInfo = optional_message("vision_msgs/LabelInfo")
VisionClass = optional_message("vision_msgs/VisionClass")
