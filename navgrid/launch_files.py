"""Launch files for ROS 2: the maps and the frames of a storey, and of a building.

`map` is the root of all frames. That of a storey lies at its floor: x and y are those of the map,
z is measured from the floor, where `map_server` has its grids and a localisation the robot.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from navgrid.grid import ROOT_FRAME, file_name
from semmap.whole_file import write_whole

BRINGUP, FRAMES = "bringup.launch.xml", "frames.launch.xml"


def write_storey_launch(
    folder: Path, params: Mapping[str, Any], frame: str, elevation: float
) -> None:
    """Write the launch files of a storey beside its maps; `params` are those by node."""
    _write(folder / FRAMES, _frames({frame: elevation}))
    _write(folder / BRINGUP, _storey(params))


def write_building_launch(folder: Path, storeys: Sequence[Mapping[str, Any]]) -> None:
    """Write the launch files of a building into the folder above those of its storeys.

    `storeys` are the contents of their ``costmap.json``, the lowest first.
    """
    _write(folder / FRAMES, _frames({s["frame"]: s["elevation"] for s in storeys}))
    _write(folder / BRINGUP, _building([s["storey"] for s in storeys]))


def ros_name(name: str) -> str:
    """Return a name as ROS takes it for nodes and topics: ASCII, no digit first, no double ``_``.

    >>> ros_name("2nd arm")
    'n2nd_arm'
    """
    found = re.sub(r"[\W_]+", "_", name, flags=re.ASCII).strip("_") or "layer"
    return f"n{found}" if found[0].isdigit() else found


def _frames(elevations: Mapping[str, float]) -> Element:
    """The static transforms from the root to each frame, metres."""
    launch = Element("launch")
    for number, (frame, z) in enumerate(elevations.items(), 1):
        words = f"--z {z:.6f} --frame-id {ROOT_FRAME} --child-frame-id {frame}"
        name = f"storey{number}_{ros_name(frame)}"
        publisher = "static_transform_publisher"
        SubElement(launch, "node", pkg="tf2_ros", exec=publisher, name=name, args=words)
    return launch


def _storey(params: Mapping[str, Any]) -> Element:
    """Serve all maps beside the launch file, wherever the folder lies, and publish the frame."""
    launch = Element("launch")
    SubElement(launch, "arg", name="use_sim_time", default="false")
    SubElement(launch, "arg", name="frames", default="true")
    SubElement(launch, "include", {"file": f"$(dirname)/{FRAMES}", "if": "$(var frames)"})

    def add(package: str, program: str, name: str, **values: str) -> None:
        node = SubElement(launch, "node", pkg=package, exec=program, name=name)
        SubElement(node, "param", {"from": "$(dirname)/nav2_params.yaml"})
        for key, value in {**values, "use_sim_time": "$(var use_sim_time)"}.items():
            SubElement(node, "param", name=key, value=value)

    servers = {name: node["ros__parameters"] for name, node in params.items() if "_server" in name}
    for name, values in servers.items():
        if "yaml_filename" in values:
            file = f"$(dirname)/{Path(values['yaml_filename']).name}"
            add("nav2_map_server", "map_server", name, yaml_filename=file)
        else:
            add("nav2_map_server", "costmap_filter_info_server", name)
    names = f"[{', '.join(servers)}]"
    manager = "lifecycle_manager"
    add("nav2_lifecycle_manager", manager, f"{manager}_maps", autostart="true", node_names=names)
    return launch


def _building(storeys: Iterable[str]) -> Element:
    """Serve the maps of the chosen storey, and publish the frames of all."""
    names = [file_name(storey) for storey in storeys]
    launch = Element("launch")
    known = f"one of {', '.join(names)}"
    SubElement(launch, "arg", name="storey", default=names[0], description=known)
    SubElement(launch, "arg", name="use_sim_time", default="false")
    SubElement(launch, "include", file=f"$(dirname)/{FRAMES}")
    storey = SubElement(launch, "include", file=f"$(dirname)/$(var storey)/{BRINGUP}")
    for name, value in (("frames", "false"), ("use_sim_time", "$(var use_sim_time)")):
        SubElement(storey, "arg", name=name, value=value)
    return launch


def _write(path: Path, launch: Element) -> None:
    ElementTree.indent(launch)
    write_whole(path, ElementTree.tostring(launch, encoding="unicode") + "\n")
