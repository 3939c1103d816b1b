"""Launch files: one tree of frames, and the maps of the chosen storey."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from sqlalchemy import Engine

from navgrid.costmap import Costmap
from navgrid.costmap_output import write_costmaps
from navgrid.grid import Grid, check_storey_names
from navgrid.launch_files import ros_name
from semmap.query.storey_scene import StoreyScene
from tests.command_line import semmap
from tests.navgrid.scenes import BASE, room

OFFICE = Path(__file__).parents[2] / "examples" / "office"
GRID = Grid((0.0, 0.0), 0.1, (30, 30))


def storey(name: str, elevation: float) -> Costmap:
    return Costmap(
        StoreyScene(name, elevation, (), (room("hall", 0, 0, 3, 3, elevation),)), [BASE], GRID
    )


def included(path: Path, **arguments: str) -> list[ElementTree.Element]:
    """The nodes that a launch file starts, by the rules of ROS 2 launch for these elements."""
    launch = ElementTree.parse(path).getroot()
    assert launch.tag == "launch"

    def value(text: str) -> str:
        text = text.replace("$(dirname)", str(path.parent))
        for name, given in arguments.items():
            text = text.replace(f"$(var {name})", given)
        assert "$(" not in text, text
        return text

    found = []
    for element in launch:
        if element.tag == "arg":
            arguments = {element.attrib["name"]: element.attrib["default"]} | arguments
        elif element.tag == "node":
            found.append(element)
        else:
            assert element.tag == "include"
            if value(element.attrib.get("if", "true")) == "true":
                passed = {a.attrib["name"]: value(a.attrib["value"]) for a in element}
                found += included(Path(value(element.attrib["file"])), **passed)
    return found


def tree(nodes: list[ElementTree.Element]) -> dict[str, tuple[str, float]]:
    """The parent and height of each frame, read as static_transform_publisher reads its words."""
    parser = argparse.ArgumentParser()
    for name in ("x", "y", "z", "qx", "qy", "qz", "roll", "pitch", "yaw"):
        parser.add_argument(f"--{name}", type=float, default=0.0)
    parser.add_argument("--frame-id", required=True)
    parser.add_argument("--child-frame-id", required=True)
    found = {}
    for node in nodes:
        if node.attrib["exec"] == "static_transform_publisher":
            assert node.attrib["pkg"] == "tf2_ros"
            read = vars(parser.parse_args(node.attrib["args"].split()))
            child, parent, z = (read.pop(k) for k in ("child_frame_id", "frame_id", "z"))
            assert child not in found, "a frame has one parent"
            assert set(read.values()) == {0.0}
            found[child] = parent, z
    return found


def test_a_building_has_one_root_and_serves_the_chosen_storey(tmp_path: Path) -> None:
    made = [storey("-1", -3.2), storey("EG", 0.0), storey("1. OG", 3.45)]
    written = write_costmaps(made, tmp_path, picture=False)
    moved = tmp_path.rename(tmp_path.with_name("moved"))
    for choice, frame in (({}, "map_1"), ({"storey": "1._OG"}, "map_1_OG")):
        nodes = included(moved / "bringup.launch.xml", **choice)
        assert tree(nodes) == {
            "map_1": ("map", -3.2),
            "map_EG": ("map", 0),
            "map_1_OG": ("map", 3.45),
        }
        names = [node.attrib["name"] for node in nodes]
        assert len({*names}) == len(names)
        (master,) = (n for n in nodes if n.attrib["name"] == "master_server")
        (params,) = (p.attrib["from"] for p in master.iter("param") if "from" in p.attrib)
        assert params == "$(dirname)/nav2_params.yaml"
        (files,) = (w for w in written if w["frame"] == frame)
        assert len(nodes) == 3 + len(files["maps"]) + 1
    alone = included(moved / "EG" / "bringup.launch.xml")
    assert tree(alone) == {"map_EG": ("map", 0.0)}


def test_one_storey_needs_no_folder(tmp_path: Path) -> None:
    write_costmaps([storey("flat", 1.5)], tmp_path, picture=False)
    assert tree(included(tmp_path / "bringup.launch.xml")) == {"map_flat": ("map", 1.5)}


@pytest.mark.parametrize("other", ["1/OG", "1-OG"])
def test_storeys_of_one_name_to_files_or_frames_are_refused(other: str, tmp_path: Path) -> None:
    with pytest.raises(
        ValueError, match=r"'1_OG' and '1.OG' would both be written as .*1_OG: rename"
    ):
        write_costmaps([storey("1_OG", 0.0), storey(other, 3.0)], tmp_path / "made")
    assert not [*tmp_path.iterdir()]
    check_storey_names(["EG", "1. OG"])


@pytest.mark.parametrize(
    ("name", "ros"), [("base", "base"), ("2nd arm", "n2nd_arm"), ("a _b", "a_b"), ("é", "layer")]
)
def test_names_are_those_of_ros(name: str, ros: str) -> None:
    assert ros_name(name) == ros


def test_the_office_has_launch_files_for_both_storeys(office_world: Engine, tmp_path: Path) -> None:
    url = office_world.url.render_as_string(hide_password=False)
    robot = (OFFICE / "delivery_robot.urdf", "--parts", OFFICE / "delivery_robot_parts.yaml")
    words = ("-o", tmp_path, "--resolution", "0.2", "--no-picture", "--json")
    done = semmap(url, "costmap", "--robot", *robot, *words)
    assert done.exit_code == 0, done.output
    stated = {w["frame"]: ("map", w["elevation"]) for w in json.loads(done.stdout)}
    nodes = included(tmp_path / "bringup.launch.xml", storey="floor-3rd")
    assert tree(nodes) == stated
    assert len(stated) == 2
