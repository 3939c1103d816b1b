import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

import semmap
from planner.readers.topology import read_topology
from semmap import cli
from semmap.cli.chosen import CliOptions
from semmap.cli.demo import run as demo
from semmap.cli.demo.choices import DemoChoices, figure_3
from semmap.draw.palette import PATH
from tests.office import OFFICE_FILES, OFFICE_ROBOT

FIGURE_4 = (
    "pass_door(door1, lab1, corridor1) · pass_door(door2, corridor1, foyer-1st) · call_elevator · "
    "pass_door(edoor1, foyer-1st, elevator-1st) · use_elevator(floor-1st, floor-3rd) · "
    "pass_door(edoor3, elevator-3rd, foyer-3rd) · pass_door(door5, foyer-3rd, corridor3) · "
    "pass_door(door6, corridor3, office4) · pickup(muffin, desk4) · "
    "pass_door(door7, office4, corridor3) · pass_door(door8, corridor3, lab2) · "
    "place(muffin, desk1)"
)


@pytest.fixture(scope="module")
def url(make_database):
    """A database of its own: the demo moves the muffin."""
    return make_database().render_as_string(hide_password=False)


@pytest.fixture(autouse=True)
def chosen(url):
    """What the command line works on."""
    before, CliOptions.url = CliOptions.url, url
    yield
    CliOptions.url = before


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "out"


@pytest.fixture
def said():
    return []


def test_the_demo_does_the_main_job_from_end_to_end(folder, said, capsys):
    pictures = demo.run_demo(
        OFFICE_FILES, folder, OFFICE_ROBOT, pixels=700, say=lambda text: said.append(str(text))
    )
    assert [str(p.relative_to(folder)) for p in pictures] == [
        "figure6_parts.png",
        "figure7_footprints.png",
        *(f"costmap/floor-1st/{name}.png" for name in ("master", "base", "arm", "pole")),
        "figure5_staircase.png",
        *(f"costmap/floor-3rd/{name}.png" for name in ("master", "base", "arm", "pole")),
        "figure9_layered.png",
        "figure9_single.png",
        "figure9_robot.png",
        "fields.png",
        "search.png",
        "floor-1st/topology.png",
        "floor-3rd/topology.png",
        "floor-1st/plan.png",
        "floor-3rd/plan.png",
        "rooms.png",
        "objects.png",
    ]
    assert all(p.is_file() for p in pictures)
    for picture in pictures[-4:-1]:  # each shows its part of the route
        pixels = np.asarray(Image.open(picture).convert("RGB"), float) / 255
        assert (np.abs(pixels - to_rgb(PATH)).max(axis=-1) < 0.05).sum() > 100
    assert any("lab1 -> office4: door1, door2, edoor1, edoor3, door5, door6" in s for s in said)
    assert any(f"on(muffin, desk1): {FIGURE_4}" in s for s in said)
    assert any("done: 21 steps by a simulated robot" in s for s in said)
    assert any("muffin1: desk4 7" in s and "To office4" in s for s in said)
    lines = capsys.readouterr().out.splitlines()
    (row,) = (line.split() for line in lines if line.startswith(":office4"))
    assert row[1] == ":desk4", "the answer in SPARQL"
    assert "       ?object a semmap:Muffin ; semmap:heldBy ?table ." in said
    before, after = [line.split()[:2] for line in lines if "BOX3D" in line]
    assert before == ["office4", "desk4"]
    assert after == ["lab2", "desk1"]
    with cli.chosen_map("office") as office:  # the README's commands come next: desk4 again
        ((room, table, _),) = office.sql(figure_3(DemoChoices("muffin", "table")))
    assert (room, table) == ("office4", "desk4")
    assert (folder / "floor-3rd" / "map.pgm").is_file()


def test_a_map_of_other_things_keeps_its_name(url, tmp_path):
    """The demo of a world writes into no map that it did not make."""
    path = tmp_path / "flat.geojson"
    path.write_text("{}")
    with semmap.connect(url) as db:
        assert demo._map_name(db, [path]) == "flat"
        db.create_map("flat").add_object("mug", size=(0.1, 0.1, 0.1), pose=(0, 0, 0))
        assert demo._map_name(db, [path]) == "flat_2"
        db.drop_map("flat")


def test_another_world_takes_files_and_folders(folder, said, tmp_path):
    world = tmp_path / "yard"
    world.mkdir()
    (world / "yard.sdf").write_text(
        "<sdf version='1.9'><world name='yard'><model name='crate'><pose>1 2 0.5 0 0 0</pose>"
        "<link name='l'><visual name='v'><geometry><box><size>1 1 1</size></box></geometry>"
        "</visual></link></model></world></sdf>"
    )
    pictures = demo.run_demo(
        [world], folder, OFFICE_ROBOT, pixels=400, say=lambda text: said.append(str(text))
    )
    assert [p.name for p in pictures] == [
        "figure6_parts.png",
        "figure7_footprints.png",
        "master.png",
        "base.png",
        "arm.png",
        "pole.png",
        "plan.png",
        "objects.png",
    ]
    assert any("none: the map has no rooms that doors join" in s for s in said)
    assert any("How many doors has each room? In SPARQL:" in s for s in said)
    with pytest.raises(LookupError, match="no world in it"):
        demo.run_demo([folder], folder, OFFICE_ROBOT)


def test_a_room_that_furniture_closes_does_not_hide_the_routes_between_the_others(url):
    with semmap.connect(url) as db:
        row = db.create_map("row")
        for x in range(0, 32, 4):
            row.add_room(f"r{x}", [(x, 0), (x + 3.9, 0), (x + 3.9, 4), (x, 4)])
        for x in range(0, 28, 4):
            row.add_door(f"d{x}", f"r{x}", f"r{x + 4}", ((x + 3.95, 1), (x + 3.95, 2.5)))
        row.add_object("crate", size=(0.8, 2, 1), pose=(7.95, 1.75, 0))
        with row.snapshot() as seen:
            topology = read_topology(seen)
        route = demo._find_route(row, topology, None, None)
        assert {route.places[0], route.places[-1]} == {"r8", "r28"}
        db.drop_map("row")
