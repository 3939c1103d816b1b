"""Parts of SDF worlds that are left out, and worlds that are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semmap.geometry.pose import Pose
from semmap.ingest.sdf.world_file import read_sdf
from semmap.ingest.world import WorldError
from tests.ingest.sdf.worlds_by_hand import (
    BOX,
    LINK,
    MESH,
    TETRAHEDRON,
    at,
    entry,
    model_file,
    read,
    surface,
)

# What is left out


OUTLINE = (
    "<polyline><point>0 0</point><point>1 0</point><point>1 1</point><height>1</height></polyline>"
)
CAPSULE = "<geometry><capsule><radius>{}</radius><length>{}</length></capsule></geometry>"
SKIPPED = {
    "missing mesh": (LINK.replace(BOX.format("1 2 3"), MESH.format("model://no.dae")), "not found"),
    "mesh on the network": (
        LINK.replace(BOX.format("1 2 3"), MESH.format("https://example.org/a.dae")),
        "network",
    ),
    "no uri": (LINK.replace(BOX.format("1 2 3"), MESH.format("")), "does not name a file"),
    "odd uri": (LINK.replace(BOX.format("1 2 3"), MESH.format("a&#10;b")), "does not name a file"),
    "not a number": (LINK.replace("1 2 3", "1 two 3"), "3 finite numbers"),
    "NaN": (LINK.replace("1 2 3", "1 nan 3"), "3 finite numbers"),
    "infinite": (LINK.replace("1 2 3", "1 1e999 3"), "3 finite numbers"),
    "too few numbers": (LINK.replace("1 2 3", "1 2"), "3 finite numbers"),
    "no size": (LINK.replace("<size>1 2 3</size>", ""), "missing"),
    "negative size": (LINK.replace("1 2 3", "1 -2 3"), "at least 1e-06 m"),
    "two outlines that cancel": (
        LINK.replace(BOX.format("1 2 3"), "<geometry>" + 2 * OUTLINE + "</geometry>"),
        "cancel out",
    ),
    "flat outline": (
        LINK.replace(
            BOX.format("1 2 3"), f"<geometry>{OUTLINE.replace('>1<', '>1e-9<')}</geometry>"
        ),
        "at least 1e-06 m",
    ),
    "hair-thin capsule": (
        LINK.replace(BOX.format("1 2 3"), CAPSULE.format("1e-9", "1")),
        "at least 1e-06 m",
    ),
    "speck of a capsule": (
        LINK.replace(BOX.format("1 2 3"), CAPSULE.format("1e-6", "1e-6")),
        "too small",
    ),
    "giant": (LINK.replace("1 2 3", "1 2 1e9"), "the limit is 10,000 m"),
    "no geometry": (LINK.replace(BOX.format("1 2 3"), ""), "no geometry"),
    "heightmap": (
        LINK.replace(BOX.format("1 2 3"), "<geometry><heightmap/></geometry>"),
        "not a supported surface",
    ),
    "unknown frame": (
        LINK.replace("<geometry>", '<pose relative_to="x">0 0 0 0 0 0</pose><geometry>'),
        "does not have or cannot place",
    ),
    "NaN pose": (
        LINK.replace("<geometry>", "<pose>0 0 nan 0 0 0</pose><geometry>"),
        "6 finite numbers",
    ),
    "zero quaternion": (
        LINK.replace(
            "<geometry>", '<pose rotation_format="quat_xyzw">0 0 0 0 0 0 0</pose><geometry>'
        ),
        "quaternion is zero",
    ),
    "far away": (LINK.replace("<geometry>", "<pose>0 0 2e4 0 0 0</pose><geometry>"), "reaches"),
    "open outline": (
        LINK.replace(
            BOX.format("1 2 3"),
            "<geometry><polyline><point>0 0</point><height>1</height></polyline></geometry>",
        ),
        "three points",
    ),
}


@pytest.mark.parametrize("case", SKIPPED)
def test_an_unusable_visual_leaves_its_model_without_it(tmp_path: Path, case: str) -> None:
    link, problem = SKIPPED[case]
    world = read(tmp_path, f'<model name="bad">{link}</model>' + at("0 0 0 0 0 0"))
    (skipped,) = world.skipped
    assert skipped.element.startswith("model bad: link base: visual v")
    assert problem in skipped.problem
    assert skipped.fix
    assert entry(world, "bad").shapes == []
    assert len(entry(world, "m").shapes) == 1


@pytest.mark.parametrize(
    ("model", "problem"),
    [
        (at("nan 0 0 0 0 0", "bad"), "6 finite numbers"),
        (at("0 0 0", "bad"), "6 finite numbers"),
        (at("0 0 343582.9 0 0 0", "bad"), "(0, 0, 343,583) m"),
        (at("0 0 0 0 0 0", "bad", relative_to="nowhere"), "does not have or cannot place"),
        ("<include><name>bad</name><uri>model://m</uri><pose>1</pose></include>", "6 finite"),
    ],
)
def test_an_instance_without_a_place_is_left_out(tmp_path: Path, model: str, problem: str) -> None:
    model_file(tmp_path, "m", LINK)
    world = read(tmp_path, model + at("0 0 0 0 0 0", "good"))
    assert [e.name for e in world.entries] == ["good"]
    (skipped,) = world.skipped
    assert "bad" in skipped.element
    assert problem in skipped.problem


def test_a_missing_model_keeps_its_place(tmp_path: Path) -> None:
    world = read(
        tmp_path,
        "<include><uri>model://Desk_01</uri><pose>1 2 3 0 0 0</pose></include>",
    )
    desk = entry(world, "Desk_01")
    assert (desk.type, desk.shapes) == ("desk", [])
    assert "not found" in world.skipped[0].problem


def test_the_other_geometry_stands_in_for_a_missing_one(tmp_path: Path) -> None:
    link = LINK.replace(BOX.format("1 2 3"), MESH.format("no.dae"))
    solid = f'<collision name="c">{BOX.format("4 5 6")}</collision></link>'
    world = read(tmp_path, f'<model name="m">{link.replace("</link>", solid)}</model>')
    assert entry(world, "m").shapes[0].role == "collision"
    np.testing.assert_allclose(np.ptp(surface(world, "m").bounds, axis=0), (4, 5, 6))
    assert len(world.skipped) == 1
    assert "geometry is used" in world.notes[0]


@pytest.mark.parametrize(
    ("has", "geometry", "role"),
    [
        ("collision", "visual", "collision"),
        ("collision", "collision", "collision"),
        ("visual", "visual", "visual"),
        ("visual", "collision", None),  # nothing collides with it
    ],
)
def test_what_only_collides_is_there(
    tmp_path: Path, has: str, geometry: str, role: str | None
) -> None:
    link = LINK.replace("visual", has)
    world = read(tmp_path, f'<model name="m">{link}</model>', geometry=geometry)
    assert [shape.role for shape in entry(world, "m").shapes] == ([role] if role else [])


def test_defects_of_a_shared_file_are_reported_once(tmp_path: Path) -> None:
    model_file(tmp_path, "m", LINK.replace(BOX.format("1 2 3"), MESH.format("no.dae")))
    world = read(tmp_path, "<include><uri>model://m</uri></include>" * 3)
    assert len(world.entries) == 3
    assert [s.element for s in world.skipped] == ["m/model.sdf: model m: link base: visual v"]


def test_a_name_that_differs_in_case_is_hinted_at(tmp_path: Path) -> None:
    (tmp_path / "Solid.obj").write_text(TETRAHEDRON)
    link = LINK.replace(BOX.format("1 2 3"), MESH.format("solid.obj"))
    world = read(tmp_path, f'<model name="m">{link}</model>')
    assert "Solid.obj" in world.skipped[0].fix


# What is refused


def test_absent_file(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="cannot be read"):
        read_sdf(tmp_path / "no.world")


LAUGHS = """<!DOCTYPE sdf [<!ENTITY a "haha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;">
<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;">]><sdf version="1.9"><world name="&c;"/></sdf>"""

REFUSED = {
    "empty": (b"", "not well-formed"),
    "truncated": (b'<sdf version="1.9"><world name="w"><model na', "not well-formed"),
    "not XML": (b"\x89PNG\r\n\x1a\n\0\0\0", "not well-formed"),
    "another root": (b"<robot name='r'/>", "<robot>"),
    "no world": (b'<sdf version="1.9"/>', "no <world>"),
    "bomb": (LAUGHS.encode(), "entities"),
    "document type": (b'<!DOCTYPE sdf SYSTEM "other.dtd"><sdf version="1.9"/>', "document type"),
    "odd encoding": (b"<?xml version='1.0' encoding='utf-99'?><sdf/>", "XML"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_file_that_cannot_be_trusted_is_refused(tmp_path: Path, case: str) -> None:
    data, problem = REFUSED[case]
    path = tmp_path / "bad.world"
    path.write_bytes(data)
    with pytest.raises(WorldError, match=problem) as error:
        read_sdf(path)
    assert "bad.world" in str(error.value)
    assert error.value.element
    assert error.value.fix


BROKEN = {
    "empty": "",
    "truncated": "<sdf",
    "bomb": LAUGHS,
    "another root": "<robot/>",
    "circle": """<sdf version="1.9"><model name="m"><link name="a"><pose relative_to="b"/></link>
        <link name="b"><pose relative_to="a"/></link></model></sdf>""",
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_included_model_is_skipped_by_name(tmp_path: Path, case: str) -> None:
    model_file(tmp_path, "m", LINK).write_text(BROKEN[case])
    place = "<pose>4 5 6 0 0 0</pose>"
    world = read(
        tmp_path,
        f"<include><name>one</name><uri>model://m</uri>{place}</include>"
        f"<include><uri>model://m</uri></include>{at('0 0 0 0 0 0', 'good')}",
    )
    (skipped,) = world.skipped
    assert skipped.element == "include one"
    assert "model://m cannot be used" in skipped.problem
    assert [(e.name, len(e.shapes)) for e in world.entries] == [("one", 0), ("m", 0), ("good", 1)]
    assert entry(world, "one").pose == Pose(4, 5, 6)


CIRCLES = {
    "frames": """<frame name="a"><pose relative_to="b"/></frame>
        <frame name="b" attached_to="c"/><frame name="c"><pose relative_to="a"/></frame>""",
    "models": at("0 0 0 0 0 0", "a", relative_to="b") + at("0 0 0 0 0 0", "b", relative_to="a"),
    "itself": at("0 0 0 0 0 0", "a", relative_to="a"),
    "inner": """<model name="m"><link name="a"><pose relative_to="b"/></link>
        <link name="b"><pose relative_to="a"/></link></model>""",
    "through a model": """<frame name="a"><pose relative_to="m::l"/></frame>
        <model name="m"><pose relative_to="a">0 0 0 0 0 0</pose><link name="l"/></model>""",
}


@pytest.mark.parametrize("case", CIRCLES)
def test_circles_of_frames_are_refused(tmp_path: Path, case: str) -> None:
    with pytest.raises(WorldError, match="relative to itself") as error:
        read(tmp_path, CIRCLES[case])
    assert " -> " in str(error.value)


def test_circles_of_includes_are_cut_and_named(tmp_path: Path) -> None:
    for one, other in (("a", "b"), ("b", "a")):
        model_file(tmp_path, one, f"<include><uri>model://{other}</uri></include>")
    world = read(tmp_path, "<include><uri>model://a</uri></include>")
    (skipped,) = world.skipped
    assert skipped.element == "a/model.sdf: include b"
    assert "leads back to model.sdf, which includes this file" in skipped.problem
    assert entry(world, "a").shapes == []


def test_endless_nesting_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="nests models: 65 levels, the limit is 64 levels"):
        read(tmp_path, '<model name="m">' * 2000 + "</model>" * 2000)


def test_a_bomb_of_includes_is_cut_where_it_exceeds_the_limit(tmp_path: Path) -> None:
    """Ten files, each with ten of the next: 10^10 boxes."""
    model_file(tmp_path, "m0", LINK)
    for level in range(1, 10):
        uri = f"<uri>model://m{level - 1}</uri>"
        includes = "".join(f"<include><name>i{n}</name>{uri}</include>" for n in range(10))
        model_file(tmp_path, f"m{level}", includes)
    world = read(tmp_path, "<include><uri>model://m9</uri></include>")
    (skipped,) = world.skipped
    assert skipped.element == "m6/model.sdf: include i0"
    assert "has 100,000 parts, the limit is 20,000 parts" in skipped.problem
    assert entry(world, "m9").shapes == []
