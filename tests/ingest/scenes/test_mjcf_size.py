"""What an MJCF file claims is refused before MuJoCo makes room for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from semmap.ingest.scenes.mjcf_scene import read_mjcf
from semmap.ingest.world import WorldError

BOX = '<geom type="box" size="1 1 1"/>'
MANY = f'<replicate count="200">{BOX}</replicate>'


def model(folder: Path, inside: str, more: str = "") -> Path:
    path = folder / "case.xml"
    path.write_text(f"<mujoco>{more}<worldbody>{BOX}{inside}</worldbody></mujoco>")
    return path


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ('<asset><texture builtin="flat" width="9000" height="9000"/></asset>', "81,000,000"),
        ('<asset><hfield name="h" nrow="9000" ncol="9000" size="1 1 1 1"/></asset>', "81,000,000"),
        ('<custom><numeric name="n" size="81000000"/></custom>', "81,000,000"),
        ('<size nuser_geom="41000000"/>', "123,000,000|164,000,000"),
    ],
)
def test_arrays(tmp_path: Path, more: str, says: str) -> None:
    with pytest.raises(WorldError, match=rf"has ({says}) pixels, the limit is 67,108,864 pixels"):
        read_mjcf(model(tmp_path, "", more))


def test_files_that_are_included_and_attached_count(tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text(f"<mujoco>{MANY}</mujoco>")
    (tmp_path / "whole.xml").write_text(f"<mujoco><worldbody>{MANY}</worldbody></mujoco>")
    include = '<replicate count="200"><include file="part.xml"/></replicate>'
    attach = '<replicate count="200"><attach model="w" body="b" prefix="a"/></replicate>'
    asset = '<asset><model name="w" file="whole.xml"/></asset>'
    for path in (model(tmp_path, include), model(tmp_path, attach, asset)):
        with pytest.raises(WorldError, match="parts, the limit is 20,000 parts"):
            read_mjcf(path)
    assert read_mjcf(model(tmp_path, '<include file="part.xml"/>')).entries
