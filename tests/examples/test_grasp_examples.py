"""The pictures of grasps."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest
from matplotlib.image import imread

from tests.manipulation.grippers import urdf

ROOT = Path(__file__).parents[2]


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / f"examples/{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def test_the_pictures_show_grasps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    urdf("panda")  # skips where the robots are not installed
    pictures = load("grasp_pictures")
    monkeypatch.setattr(pictures, "SHOWN", 3)
    monkeypatch.setattr("sys.argv", ["grasp_pictures", str(tmp_path)])
    pictures.main()
    drawn = {file.name: imread(file)[..., :3] for file in tmp_path.glob("*.png")}
    assert set(drawn) == {"grasps.png", "grippers.png"}
    assert all(picture.std() > 0.02 for picture in drawn.values())
