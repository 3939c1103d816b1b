"""Exports as programs of others read them; each is skipped where its program is not installed."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import semmap

SDF_READER = """
#include <iostream>
#include <sdf/sdf.hh>
int main(int, char** argv) {
  sdf::Root root;
  const auto errors = root.Load(argv[1]);
  for (const auto& error : errors) std::cerr << error << std::endl;
  if (!errors.empty() || !root.WorldByIndex(0)) return 1;
  const auto* world = root.WorldByIndex(0);
  for (std::uint64_t i = 0; i < world->ModelCount(); ++i) {
    const auto* model = world->ModelByIndex(i);
    const auto* mesh = model->LinkByIndex(0)->CollisionByIndex(0)->Geom()->MeshShape();
    std::cout << model->Name() << '\\t' << model->Static() << '\\t' << model->RawPose().Pos()
              << '\\t' << mesh->Uri() << '\\n';
  }
}
"""
"""What Gazebo's parser (libsdformat) finds in a world: the models, and where they stand."""

BLENDER = """
import bpy, json, sys
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=sys.argv[1])
bpy.context.view_layer.update()
boxes = {}
for each in bpy.data.objects:
    if each.type == "MESH":
        corners = [each.matrix_world @ v.co for v in each.data.vertices]
        boxes[each.name] = [f(c[i] for c in corners) for f in (min, max) for i in range(3)]
print("\\n" + json.dumps(boxes))
"""
"""The boxes of what Blender shows of a scene, metres, z up."""


@pytest.fixture(scope="module")
def sdf_reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    try:
        found = subprocess.run(
            ["pkg-config", "--cflags", "--libs", "sdformat12"],
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("needs libsdformat-dev")
    folder = tmp_path_factory.mktemp("sdf")
    (folder / "reader.cpp").write_text(SDF_READER)
    command = ["g++", "-std=c++17", "reader.cpp", "-o", "reader", *found.stdout.split()]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "reader"


def test_gazebo_reads_worlds(furnished: semmap.Map, sdf_reader: Path, tmp_path: Path) -> None:
    path = furnished.export(tmp_path / "flat.sdf")
    done = subprocess.run([sdf_reader, path], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    models = {}
    for line in done.stdout.splitlines():
        name, static, at, uri = line.split("\t")
        assert (tmp_path / uri).exists()
        assert static == ("0" if furnished[name].kind == "agent" else "1")
        models[name] = np.array(at.split(), float)
    assert models.keys() == {e.name for e in furnished if e.kind in ("object", "agent") and e.size}
    for name, at in models.items():
        assert at == pytest.approx(furnished[name].pose[:3], abs=1e-4)


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs Blender (bpy)")
@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_blender_shows_scenes(furnished: semmap.Map, ending: str, tmp_path: Path) -> None:
    path = furnished.export(tmp_path / f"flat{ending}")
    command = [sys.executable, "-c", BLENDER, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    shown = json.loads(done.stdout.splitlines()[-1])
    assert shown.keys() == {
        e.name for e in furnished if e.kind != "connector" and e.box and e.geometry.area
    }
    for name, box in shown.items():
        own = list(furnished[name].box)
        if furnished[name].kind in ("room", "region"):
            own[5] = own[2]  # level faces
        assert box == pytest.approx(own, abs=1e-5), name
