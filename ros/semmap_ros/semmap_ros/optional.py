"""Messages of packages that PyPI does not have; `scripts/ros_messages` builds them."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def interface(name: str) -> Any:
    """Return the class of a type such as ``tf2_msgs/msg/TFMessage``; None without its package."""
    package, kind, own = name.split("/")
    try:
        return getattr(import_module(f"{package}.{kind}"), own, None)
    except ModuleNotFoundError:
        return None


TFMessage = interface("tf2_msgs/msg/TFMessage")
CostmapFilterInfo = interface("nav2_msgs/msg/CostmapFilterInfo")
SetRouteGraph = interface("nav2_msgs/srv/SetRouteGraph")
NavigateToPose = interface("nav2_msgs/action/NavigateToPose")
Detection3DArray = interface("vision_msgs/msg/Detection3DArray")
LabelInfo = interface("vision_msgs/msg/LabelInfo")
VisionClass = interface("vision_msgs/msg/VisionClass")
Call = interface("semmap_ros_interfaces/srv/Call")
