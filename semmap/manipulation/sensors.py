"""The sensors of a robot, as its URDF describes them: what simulators simulate, and link names."""

from __future__ import annotations

import re
from dataclasses import dataclass
from xml.etree import ElementTree

CAPABILITIES = {
    "depth camera": ("sensing", "seeing"),
    "camera": ("seeing",),
    "laser": ("ranging",),
    "inertial": ("orienting",),
    "force": ("feeling",),
    "contact": ("feeling",),
}
"""What each kind of sensor is able to do; the kinds that serve manipulation most come first."""

TYPES = {
    "depth": "depth camera",
    "depth_camera": "depth camera",
    "rgbd": "depth camera",
    "rgbd_camera": "depth camera",
    "camera": "camera",
    "wideanglecamera": "camera",
    "multicamera": "camera",
    "ray": "laser",
    "gpu_ray": "laser",
    "lidar": "laser",
    "gpu_lidar": "laser",
    "imu": "inertial",
    "force_torque": "force",
    "contact": "contact",
}
"""Kinds by the type of a sensor in an element `gazebo`."""

NAMES = (
    (re.compile(r"(^|_)(accel|gyro|imu)(_|$)"), "inertial"),
    (re.compile(r"(^|_)depth_.*optical_frame$"), "depth camera"),
    (re.compile(r"_optical_frame$"), "camera"),
    (re.compile(r"(^|_)(laser|lidar|hokuyo)(_|$)"), "laser"),
    (re.compile(r"(^|_)(ft|force_torque)(_|$)"), "force"),
)
"""Kinds by the name of a link; the first that matches. A camera looks along its optical frame."""

ENDS = re.compile(r"(_tool|_optical|_frame|_link|_sensor)+$")
"""What names of links and sensors end with."""


@dataclass(frozen=True)
class Sensor:
    """A sensor on a link; its name lacks endings such as ``_optical_frame``."""

    name: str
    kind: str
    link: str


def read_sensors(urdf: str) -> list[Sensor]:
    """The sensors of a URDF, by its elements `gazebo`, else its links; the most useful first."""
    root = ElementTree.fromstring(urdf)
    found: dict[str, Sensor] = {}
    for element in root.iter("gazebo"):
        for child in element:
            tag = child.tag.rpartition("}")[2]
            type_ = child.get("type", "") if tag == "sensor" else tag
            if (tag == "sensor" or "#sensor}" in child.tag) and type_ in TYPES:
                link = element.get("reference", "")
                name = ENDS.sub("", child.get("name", link))
                found.setdefault(name, Sensor(name, TYPES[type_], link))
    stated = {sensor.kind for sensor in found.values()}
    if "depth camera" in stated:
        stated.add("camera")
    for element in root.findall("link"):
        link = element.get("name", "")
        kind = next((kind for pattern, kind in NAMES if pattern.search(link)), None)
        if kind is not None and kind not in stated:
            name = ENDS.sub("", link)
            found.setdefault(name, Sensor(name, kind, link))
    order = list(CAPABILITIES)
    return sorted(found.values(), key=lambda sensor: order.index(sensor.kind))
