import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from planner import demo
from semmap.draw.palette import PATH


@pytest.fixture
def said():
    return []


def test_the_demo_does_the_main_job_from_end_to_end(commands, folder, said, capsys):
    pictures = demo.run_demo([], folder, pixels=700, say=lambda text: said.append(str(text)))
    assert [str(p.relative_to(folder)) for p in pictures] == [
        "figure6_parts.png",
        "figure7_footprints.png",
        *(f"floor-1st/costmap/{name}.png" for name in ("master", "base", "arm", "pole")),
        "figure5_staircase.png",
        *(f"floor-3rd/costmap/{name}.png" for name in ("master", "base", "arm", "pole")),
        "figure9_layered.png",
        "figure9_single.png",
        "figure9_robot.png",
        "fields.png",
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
    table = capsys.readouterr().out
    assert "office4" in table
    assert "desk4" in table
    assert (folder / "floor-3rd" / "map.pgm").is_file()


def test_another_world_takes_files_and_folders(commands, folder, said, tmp_path):
    world = tmp_path / "yard"
    world.mkdir()
    (world / "yard.sdf").write_text(
        "<sdf version='1.9'><world name='yard'><model name='crate'><pose>1 2 0.5 0 0 0</pose>"
        "<link name='l'><visual name='v'><geometry><box><size>1 1 1</size></box></geometry>"
        "</visual></link></model></world></sdf>"
    )
    pictures = demo.run_demo([world], folder, pixels=400, say=lambda text: said.append(str(text)))
    assert [p.name for p in pictures] == [
        "figure6_parts.png", "figure7_footprints.png", "master.png", "base.png", "arm.png",
        "pole.png", "plan.png", "objects.png",
    ]  # fmt: skip
    assert any("none: the map has no rooms that doors join" in s for s in said)
    with pytest.raises(LookupError, match="no world in it"):
        demo.run_demo([folder], folder)
