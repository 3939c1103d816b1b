"""What cannot be used is refused with a clear text, and changes no row of any table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import semmap as package
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.store.bundle import export_bundle, trust
from tests.command_line import semmap
from tests.conftest import MakeDatabase
from tests.manipulation.cup_map import candidate
from tests.manipulation.grippers import BY_HAND
from tests.manipulation.store.test_bundle import KEY, PUBLIC, changed, signed
from tests.stored import stored

NO_FINGERS = """<robot name="stump">
  <link name="base"/><link name="arm"><visual><geometry><box size="0.1 0.1 0.5"/></geometry></visual></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""  # noqa: E501


@pytest.fixture(scope="module")
def shelf(
    make_database: MakeDatabase, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path]:
    """A map with a table, a flat sheet and a cup, a gripper, and files that cannot be used."""
    url = make_database().render_as_string(hide_password=False)
    folder = tmp_path_factory.mktemp("bad")
    (folder / "plates.urdf").write_text(BY_HAND)
    (folder / "stump.urdf").write_text(NO_FINGERS)
    np.save(folder / "nan.npy", np.full((50, 60, 3), np.nan))
    with package.connect(url) as db:
        map_ = db.create_map("shelf")
        map_.add_room("room", [(0, 0), (3, 0), (3, 3), (0, 3)], floor=0, ceiling=2.5)
        map_.add_object("table", type="table", size=(1, 1, 0.7), pose=(1.5, 1.5, 0))
        sheet = trimesh.Trimesh([[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0]], [[0, 1, 2]])
        map_.add_object("sheet", type="paper", define=True, mesh=sheet, pose=(1.5, 1.5, 0.71))
        cup = trimesh.creation.cylinder(0.03, 0.1)
        map_.add_object("cup", type="cup", mesh=cup, pose=(1.2, 1.5, 0.75))
    add = ("manipulation", "add-gripper", folder / "plates.urdf", "--name", "plates")
    assert semmap(url, *add).exit_code == 0
    with package.connect(url) as db:
        here = db.map("shelf").connection
        add_actions(here, "cup", "plates", [candidate()])
        trust(here, "shelf", PUBLIC)
        export_bundle(here, folder / "own.bundle", "shelf", key=KEY)
    content = (folder / "own.bundle").read_bytes()
    later = signed(changed(content, 0, '"version": 1', '"version": 2'))
    (folder / "later.bundle").write_bytes(later)
    return url, folder


OBSERVE = ("observe", "--view", "0.3,1.5,1.2,0,0.4", "--looked-for", "cup", "--cloud")
REFUSED = {
    "a gripper without fingers": (("manipulation", "add-gripper"), "stump.urdf", "no link has two"),
    "a robot without fingers": (("manipulation", "add-robot"), "stump.urdf", "no link has two"),
    "a cup of no radius": (
        ("manipulation", "add-gripper", "--suction", "0"),
        "stump.urdf",
        "above 0",
    ),
    "a cup on no link": (
        ("manipulation", "add-gripper", "--suction", "0.01"),
        "stump.urdf",
        "palm=LINK",
    ),
    "a bundle of another version": (("manipulation", "import"), "later.bundle", "of version 2"),
    "a cloud of NaN": (OBSERVE, "nan.npy", "0 finite points of 3000"),
    "a mesh of no volume": (("grasp", "sheet"), None, "flat, it has no volume"),
    "its shape": (("manipulation", "shapes", "sheet"), None, "flat, it has no volume"),
    "its places": (("place", "sheet", "--on", "table"), None, "flat, it has no volume"),
    "its pushes": (("push", "sheet"), None, "no volume|no area|stands on nothing"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_and_nothing_is_stored(shelf: tuple[str, Path], name: str) -> None:
    url, folder = shelf
    words, file, text = REFUSED[name]
    before = stored(url)
    given: tuple[Any, ...] = (*words, *([folder / file] if file else []))
    map_ = () if words[0] == "manipulation" and "shapes" not in words else ("--map", "shelf")
    try:
        told = semmap(url, *given, *map_)
    except ValueError as error:
        told_text = str(error)
    else:
        assert told.exit_code == 1 or name == "its shape"
        told_text = told.stderr
    assert any(part in told_text for part in text.split("|")), told_text
    assert stored(url) == before


def test_a_grasp_of_an_unknown_frame(shelf: tuple[str, Path]) -> None:
    url, _ = shelf
    before = stored(url)
    with package.connect(url) as db:
        here = db.map("shelf").connection
        with pytest.raises(LookupError, match="tabel"):
            add_actions(here, "cup", "plates", [candidate(), candidate(yaw=1.0)], frame="tabel")
    assert stored(url) == before
    assert json.loads(semmap(url, "grasp", "cup", "--stored", "--map", "shelf", "--json").stdout)
