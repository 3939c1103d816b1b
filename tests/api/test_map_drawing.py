"""`Map.draw`: plans and answers as PNG and SVG."""

from __future__ import annotations

import math
import re
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import trimesh
from matplotlib.colors import to_rgb
from PIL import Image

from semmap.api import answer_pictures
from semmap.api.answer_pictures import FIELD_COLOURS, grasp_fork
from semmap.api.map import Map
from semmap.api.operations import OPERATIONS
from semmap.draw.picture import SVG, Picture
from semmap.error import Error, InvalidArgumentError
from semmap.geometry.pose import Pose
from semmap.manipulation.retrieval import DEFAULT_GRIPPER
from semmap.server.calls import OperationCall

HUNDREDFOLD = "BIND(:x(?v) + 100 * :y(?v) AS ?x)"
"""Another number for each column of voxels."""


def pixels_of(picture: Picture, colour: str) -> int:
    """How many pixels have exactly this colour."""
    pixels = np.asarray(Image.open(BytesIO(picture.png)).convert("RGB"))
    return int((pixels == np.rint(255 * np.array(to_rgb(colour)))).all(axis=2).sum())


def svg_texts(picture: Picture, folder: Path) -> str:
    """The texts of a picture as matplotlib notes them beside their shapes."""
    return picture.save(folder / "picture.svg").read_text(encoding="utf-8")


@pytest.fixture
def house(flat: Map) -> Map:
    flat.add_storey("upper", elevation=3, height=3)
    flat.add_room("loft", shapely.box(0, 0, 8, 3), floor=3, ceiling=5.5)
    flat.add_object("lamp1", type="lamp", size=(0.2, 0.2, 0.4), pose=(1, 1, 3))
    return flat


def test_voxels_have_a_colour_for_each_value(house: Map) -> None:
    strip = "SELECT ?v ?o { ?v :inRoom ?o FILTER(:y(?v) < 0.2) }"
    whole, ground = house.draw(field=strip), house.draw("ground", field=strip)
    assert [pixels_of(whole, colour) > 50 for colour in FIELD_COLOURS[:4]] == [True] * 3 + [False]
    assert [pixels_of(ground, colour) > 50 for colour in FIELD_COLOURS[:3]] == [True, True, False]
    air = house.draw("ground", field="inRoom")
    assert min(pixels_of(ground, c) - pixels_of(air, c) for c in FIELD_COLOURS[:2]) > 50


def test_storeys_are_one_below_another_in_svg(house: Map, tmp_path: Path) -> None:
    plan = house.draw()
    root = ElementTree.parse(plan.save(tmp_path / "plan.svg")).getroot()
    pages = root.findall(f"{{{SVG}}}svg")
    bottoms = np.cumsum([float(page.attrib["height"]) for page in pages])
    assert [float(page.attrib["y"]) for page in pages] == [0.0, *bottoms[:1].tolist()]
    width, height = Image.open(BytesIO(plan.png)).size
    assert float(root.attrib["height"][:-2]) / bottoms[-1] == pytest.approx(1, rel=1e-4)
    sides = [float(number) for number in root.attrib["viewBox"].split()[2:]]
    assert sides[0] / sides[1] == pytest.approx(width / height, rel=0.01)
    with pytest.raises(ValueError, match=r"choose one for \.pdf"):
        plan.save(tmp_path / "plan.pdf")


def test_answers_are_drawn(house: Map, tmp_path: Path) -> None:
    way = house.draw(route="mug7", start="hall")
    assert way == house.route("hall", "mug7").plot()
    found = house.search("mug", start="hall")
    search = house.draw(search="mug", start="hall")
    assert search == found.plot()
    numbers = re.findall(r"<!-- (\d+) -->", svg_texts(search, tmp_path))
    views = {(look.pose.x, look.pose.y, look.pose.yaw) for look in found.tour}
    assert {*map(str, range(1, len(views) + 1))} <= {*numbers}
    for picture in (way, search, house.draw("ground", belief="mug7")):
        assert (
            ElementTree.parse(picture.save(tmp_path / "picture.svg")).getroot().tag.endswith("svg")
        )


def test_pictures_say_what_they_do_not_show(house: Map, tmp_path: Path) -> None:
    house.add_object("ghost", type="desk", in_="kitchen")
    (note,) = house.draw("ground").notes
    assert note == "ground: 1 object is without a shape, and not drawn: ghost"
    told = house.draw(route="mug7", start="hall").notes
    assert any("ghost" in note for note in told)
    house.add_object("lamp2", type="lamp", size=(0.2, 0.2, 0.4), pose=(1, 1, 0))
    belief = house.where("lamp")
    picture = house.draw("ground", belief="lamp")
    above, nowhere = belief["loft"], belief["elsewhere"]
    assert above > 0.1
    assert picture.notes == (f"{above:.0%} is on upper, another storey",)
    told = f"{100 * above:.0f} % on others, {100 * nowhere:.0f} % in no known place"
    assert told in svg_texts(picture, tmp_path)
    below = house.draw("upper", belief="lamp")
    plain = house.draw("ground", belief="lamp")
    house.add_object("beam", type="beam", size=(3, 0.2, 0.2), pose=(3, 1, 2.2))
    house.add_object("pile", type="wall", size=(3, 0.2, 0.2), pose=(3, 1, -1))
    house.add_object("chandelier", type="object", size=(1, 1, 0.2), pose=(3, 1, 2.2))
    assert house.draw("ground", belief="lamp") == plain, "no such things are on a plan"
    assert house.draw("upper", belief="lamp") == below


def test_letters_without_a_font_and_signs_that_are_none(flat: Map, tmp_path: Path) -> None:
    flat.add_room("\U00012000 tablet room", shapely.box(20, 0, 25, 4), floor=0, ceiling=2.5)
    picture = flat.draw(title="a\x00b")
    (note,) = [note for note in picture.notes if "no font here has" in note]
    assert "has \U00012000: boxes" in note
    ElementTree.parse(picture.save(tmp_path / "plan.svg"))
    assert "a\\x00b" in svg_texts(picture, tmp_path)


@pytest.mark.parametrize("given", [{"width": 0}, {"width": 10**7}, {"cut": 0}, {"cut": math.nan}])
def test_sizes_of_views_in_3d(flat: Map, given: dict[str, Any]) -> None:
    with pytest.raises(Error, match=re.escape(next(iter(given)))):
        flat.draw_3d(**given)


def test_too_many_voxels_of_a_property_are_coarser(
    house: Map, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their colours cover what the finer ones do, but for a voxel at the borders."""
    fine = house.draw("ground", field="inRoom")
    monkeypatch.setattr(answer_pictures, "MOST_ROWS", 50_000)
    coarse = house.draw("ground", field="inRoom")
    assert re.search(r"inRoom, voxels of 0\.[24] m", svg_texts(coarse, tmp_path))
    sizes = [np.array(Image.open(BytesIO(each.png)).size) for each in (fine, coarse)]
    assert np.abs(sizes[0] - sizes[1]).max() < 40
    with pytest.raises(ValueError, match="50000 are drawn at most: ask for fewer"):
        house.draw(field="SELECT ?v ?o { ?v :inRoom ?o }")


def test_grasps_are_drawn_as_forks_where_they_are_stored(house: Map, tmp_path: Path) -> None:
    house.database.add_gripper(DEFAULT_GRIPPER, "plates", prefer=True)
    with pytest.raises(LookupError, match=r"mug7: no grasp is stored.*semmap grasp mug7"):
        house.draw(grasps="mug7")
    house.grasps("mug7")
    count = len(house.grasps("mug7", stored=True, check=False, limit=99))
    assert count > 10
    told = f"{count} grasps" if count < 50 else "best 50 grasps"
    assert f"mug7: {told}, the likelier" in svg_texts(house.draw(grasps="mug7"), tmp_path)


def test_servers_draw_costs_of_stored_robots_alone(house: Map) -> None:
    call = OperationCall(next(each for each in OPERATIONS if each.method == "Map.draw"))
    for file in ("/tmp/robot.urdf", "robot.urdf", "robot.xacro"):
        for word in ("costmap", "robot"):
            with pytest.raises(InvalidArgumentError, match="the name of one in the map"):
                call.result(house, {word: file})


def test_a_legend_names_twenty_values_and_counts_the_others(house: Map, tmp_path: Path) -> None:
    for number in range(25):
        x = 0.3 * number
        house.add_room(f"booth{number}", shapely.box(x, 5, x + 0.2, 5.2), floor=0, ceiling=2)
    told = svg_texts(house.draw(field="inRoom"), tmp_path)
    assert "... and 9 more" in told
    (legend,) = ElementTree.fromstring(told).iterfind(f".//{{{SVG}}}g[@id='legend_1']")
    patches = [each for each in legend if each.attrib["id"].startswith("patch")]
    assert len(patches) == 1 + 20  # its frame, and the colours
    assert told.count("<!-- booth") + told.count("<!-- hall") + told.count("<!-- kitchen") == 19


def test_forks_reach_as_wide_as_the_gripper_opens() -> None:
    """In the grasp frame, whose origin is between the pads: z is the approach, x closes."""
    turned = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.1, 0.2, 0.3))
    mesh = grasp_fork(0.06)
    fork = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert fork.bounds[:, 0] == pytest.approx([-0.03, 0.03], abs=0.002)
    assert fork.bounds[:, 1] == pytest.approx([0, 0], abs=0.002)
    assert fork.bounds[1, 2] == pytest.approx(0, abs=0.002)
    tips = fork.vertices[fork.vertices[:, 2] > -0.01]
    moved = mesh.moved(Pose.from_matrix(turned)).vertices
    assert (
        np.isclose(trimesh.transform_points(tips, turned)[:, None], moved[None], atol=1e-9)
        .all(axis=2)
        .any(axis=1)
        .all()
    )


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"route": "mug7"}, "give start"),
        ({"route": "mug7", "belief": "mug7"}, "route and belief are several pictures"),
        ({"robot": "tiago"}, "those of a route or a search"),
        ({"belief": "mug7", "walls": False}, "for a plan without an answer"),
        ({"storey": "attic", "belief": "mug7"}, "no storey named attic"),
        ({"storey": "upper", "route": "mug7", "start": "hall"}, "not lead through upper"),
        ({"storey": "upper", "grasps": "mug7"}, "leave out storey"),
        ({"grasps": "desk4"}, "add-gripper"),
        ({"field": "inGarden"}, "inGarden"),
        ({"field": "SELECT ?o { ?o :on :desk4 }"}, "no voxel answers"),
        ({"costmap": "nobody"}, "nobody"),
        (
            {"field": "SELECT ?v ?x { ?v :inRoom :kitchen BIND(:x(?v) + :y(?v) * 100 AS ?x) }"},
            "values",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(house: Map, asked: dict[str, Any], told: str) -> None:
    with pytest.raises(Error, match=re.escape(told)):
        house.draw(**asked)
