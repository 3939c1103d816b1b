"""The pictures of grasps."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.image import imread

from tests.examples.script import load_example
from tests.manipulation.grippers import urdf

ROOT = Path(__file__).parents[2]


def test_the_pictures_show_grasps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    urdf("panda")  # skips where the robots are not installed
    pictures = load_example("grasp_pictures")
    monkeypatch.setattr(pictures, "SHOWN", 3)
    monkeypatch.setattr("sys.argv", ["grasp_pictures", str(tmp_path)])
    pictures.main()
    drawn = {file.name: imread(file)[..., :3] for file in tmp_path.glob("*.png")}
    assert set(drawn) == {"grasps.png", "grippers.png", "mesh_grasps.png"}
    assert all(picture.std() > 0.02 for picture in drawn.values())
