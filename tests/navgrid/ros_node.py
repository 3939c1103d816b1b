"""Start nodes of rclpy as a launch file would, and print the parameters that they have.

Run by a Python that has rclpy: standard input has ``[{"name", "namespace", "args"}]``, standard
output gets the parameters of each. Nav2's own nodes declare most parameters with a type; so do
these, and rclpy refuses another one.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.validate_full_topic_name import validate_full_topic_name

TYPE = Parameter.Type
MAP_SERVER = {"yaml_filename": TYPE.STRING, "topic_name": TYPE.STRING, "frame_id": TYPE.STRING}
FILTER_INFO = {
    "type": TYPE.INTEGER,
    "filter_info_topic": TYPE.STRING,
    "mask_topic": TYPE.STRING,
    "base": TYPE.DOUBLE,
    "multiplier": TYPE.DOUBLE,
}
COSTMAP = {
    "global_frame": TYPE.STRING,
    "resolution": TYPE.DOUBLE,
    "robot_radius": TYPE.DOUBLE,
    "track_unknown_space": TYPE.BOOL,
    "trinary_costmap": TYPE.BOOL,
    "lethal_cost_threshold": TYPE.INTEGER,
    "plugins": TYPE.STRING_ARRAY,
    "static_layer.plugin": TYPE.STRING,
    "static_layer.map_topic": TYPE.STRING,
    "static_layer.map_subscribe_transient_local": TYPE.BOOL,
}
FILTERS = {
    "plugin": TYPE.STRING,
    "enabled": TYPE.BOOL,
    "filter_info_topic": TYPE.STRING,
    "speed_limit_topic": TYPE.STRING,
}
MANAGER = {"autostart": TYPE.BOOL, "node_names": TYPE.STRING_ARRAY}
TOPICS = ("topic_name", "filter_info_topic", "mask_topic")


def declared(name: str, given: set[str]) -> dict[str, Any]:
    """The parameters that Nav2's node of this name declares."""
    if name == "global_costmap":
        filters = {f"{n}_filter" for n in ("keepout", "speed")} & {k.split(".")[0] for k in given}
        found = {f"{f}.{key}": kind for f in filters for key, kind in FILTERS.items()}
        return COSTMAP | found | ({"filters": TYPE.STRING_ARRAY} if filters else {})
    if name.endswith("_filter_info_server"):
        return FILTER_INFO
    if name.endswith("_server"):
        return MAP_SERVER
    if name.startswith("lifecycle_manager"):
        return MANAGER
    return {"global_frame_id": TYPE.STRING} if name == "amcl" else {}


def parameters(about: dict[str, Any]) -> dict[str, Any]:
    """Start a node, and return its parameters."""
    context = Context()
    rclpy.init(args=["--ros-args", *about["args"]], context=context)
    try:
        node = Node(about["name"], namespace=about["namespace"], context=context)
        given = node._parameter_overrides
        types = declared(node.get_name(), {*given})
        if types:
            unknown = given.keys() - types.keys() - {"use_sim_time"}
            assert not unknown, f"{node.get_name()} of Nav2 does not read {sorted(unknown)}"
        for name in given.keys() | (types.keys() & given.keys()):
            if not node.has_parameter(name):
                node.declare_parameter(name, types.get(name, given[name].type_))
        for topic in TOPICS:
            if node.has_parameter(topic):
                full = node.get_parameter(topic).value
                full = full if full.startswith("/") else f"{node.get_namespace()}/{full}"
                validate_full_topic_name(full.replace("//", "/"))
        found = {name: node.get_parameter(name).value for name in given}
        node.destroy_node()
        return {k: list(v) if hasattr(v, "tolist") else v for k, v in found.items()}
    finally:
        rclpy.shutdown(context=context)


if __name__ == "__main__":
    print(json.dumps([parameters(about) for about in json.load(sys.stdin)]))
