"""The parameters and launch files, loaded by ROS 2 itself: rclpy, by its own wheels.

The project does not need ROS; `tests/ros_python.py` finds a Python that has rclpy.
"""

from __future__ import annotations

import json
import shlex
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import shapely
import yaml

from navgrid.costmap import Costmap
from navgrid.costmap_output import write_costmaps
from navgrid.grid import Grid
from semmap.query.storey_scene import StoreyScene
from tests.navgrid.scenes import BASE, region, room, square
from tests.navgrid.scenes import part as part_of
from tests.ros_python import ROS_PYTHON, WHY_NOT

HERE = Path(__file__).parent

pytestmark = pytest.mark.skipif(not ROS_PYTHON, reason=WHY_NOT)


def started(nodes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The parameters that rclpy gives to nodes."""
    done = subprocess.run(
        [ROS_PYTHON, str(HERE / "ros_node.py")],
        input=json.dumps(nodes),
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return found


def storey(name: str, elevation: float) -> Costmap:
    hall = room("hall", -0.5, 0.5, 3, 3.2, elevation)
    zones = (
        region(3, shapely.box(2, 0.5, 3, 1.2), "staircase"),
        region(4, shapely.box(0, 2, 1, 2.4), "speed_zone", speed_limit=0.3),
    )
    arm = part_of("2. Arm é", 0.85, 1.05, square(0.1, 0.35))
    made = StoreyScene(name, elevation, zones, (hall,))
    return Costmap(made, [BASE, arm], Grid((-1.03, 0.4), 0.05, (60, 90)))


def flat(values: dict[str, Any], head: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in values.items():
        found |= flat(value, f"{head}{key}.") if isinstance(value, dict) else {head + key: value}
    return found


def by_node(tree: dict[str, Any], path: tuple[str, ...] = ()) -> dict[tuple[str, ...], Any]:
    """The parameters of each node of a file, by its namespace and name."""
    if "ros__parameters" in tree:
        return {path: flat(tree["ros__parameters"])}
    found: dict[tuple[str, ...], Any] = {}
    for name, inner in tree.items():
        found |= by_node(inner, (*path, name))
    return found


@pytest.fixture
def building(tmp_path: Path) -> Path:
    write_costmaps([storey("1. UG", -3.25), storey("EG", 0.0)], tmp_path, picture=False)
    return tmp_path


def test_each_node_gets_its_parameters(building: Path) -> None:
    for folder in ("1._UG", "EG"):
        file = building / folder / "nav2_params.yaml"
        stated = by_node(yaml.safe_load(file.read_text()))
        assert len(stated) >= 12
        nodes = [
            {"name": path[-1], "namespace": "/" + "/".join(path[:-1]), "args": [*_params(file)]}
            for path in stated
        ]
        for path, found in zip(stated, started(nodes), strict=True):
            assert found == stated[path], path


def test_the_launched_nodes_get_the_maps_beside_the_launch_file(building: Path) -> None:
    folder = (building / "EG").rename(building / "moved")
    launch = ElementTree.parse(folder / "bringup.launch.xml").getroot()
    nodes = [
        {"name": "unnamed", "namespace": "", "args": _words(node, folder)}
        for node in launch.iter("node")
    ]
    made = dict(zip((n.attrib["name"] for n in launch.iter("node")), started(nodes), strict=True))
    served = {name: p for name, p in made.items() if "yaml_filename" in p}
    assert {Path(p["yaml_filename"]).parent for p in served.values()} == {folder}
    assert {p["frame_id"] for p in served.values()} == {"map_EG"}
    assert len({p["topic_name"] for p in served.values()}) == len(served) >= 8
    manager = made.pop("lifecycle_manager_maps")
    assert (manager["autostart"], {*manager["node_names"]}) == (True, made.keys())
    for info in ("keepout", "speed"):
        topic = made[f"{info}_filter_info_server"]["mask_topic"]
        assert topic == "/" + made[f"{info}_mask_server"]["topic_name"]


def _params(file: Path) -> tuple[str, ...]:
    return "--params-file", str(file)


def _words(node: ElementTree.Element, folder: Path) -> list[str]:
    """The arguments of a node, as ros2 launch makes them of its element."""
    words = ["-r", f"__node:={node.attrib['name']}"]
    for param in node.iter("param"):
        if "from" in param.attrib:
            words += _params(Path(param.attrib["from"].replace("$(dirname)", str(folder))))
            continue
        value = param.attrib["value"].replace("$(dirname)", str(folder))
        words += ["-p", f"{param.attrib['name']}:={value.replace('$(var use_sim_time)', 'false')}"]
    assert all(shlex.split(shlex.quote(word)) == [word] for word in words)
    return words
