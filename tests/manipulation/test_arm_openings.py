"""A TIAGo opens drawers and doors from the command line; yourdfpy follows hand and handle."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yourdfpy
from numpy.typing import NDArray

import semmap as package
from semmap.geometry.pose import Pose
from tests.command_line import semmap
from tests.conftest import MakeDatabase
from tests.manipulation.cabinets import Cabinet
from tests.manipulation.grippers import real_gripper, urdf

HEIGHT = 0.55
"""Metres from the floor to the bottom of a cabinet."""

DRAWER = Cabinet("drawer", "bar", 0.4, 0.2, 0.4, 0.02, 1, 0.25, 0.045, 0.007, 0.14, apart=True)
DOOR = Cabinet("door", "bar", 0.35, 0.4, 0.3, 0.02, -1, 1.2, 0.045, 0.007, 0.14)


@pytest.fixture(scope="module")
def url(make_database: MakeDatabase, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    address = make_database().render_as_string(hide_password=False)
    folder = tmp_path_factory.mktemp("cabinets")
    with package.connect(address) as db:
        db.add_manipulator(urdf("tiago"), "tiago")
        db.add_manipulator(urdf("panda"), "panda")
        for name, cabinet in (("drawers", DRAWER), ("doors", DOOR)):
            (folder / name).mkdir()
            db.import_file(cabinet.write(folder / name / "cabinet.urdf"), map=name)
            db.map(name)["cabinet"].move_to(0, 0, HEIGHT)
        yield address


def planned(url: str, *words: str) -> dict[str, Any]:
    told = semmap(url, *words, "--plan", "--json")
    print(told.stderr)
    assert told.exit_code == 0, told.stderr
    (row,) = json.loads(told.stdout)
    return row

READY = '{"panda_joint2": -0.6, "panda_joint4": -2.2, "panda_joint6": 1.6, "panda_joint7": 0.8}'

@pytest.mark.parametrize("base", ["-0.85,-0.2,0,0.3", "-0.75,0.3,0,0.3", "-0.8,0,0,0.4", "-0.7,-0.4,0.3,0.4"])
def test_open(url: str, base: str) -> None:
    import time
    t = time.time()
    row = planned(url, "open", "door", "--base", base, "--map", "doors", "--robot", "panda", "--state", READY)
    print(row["family"], {k: len(v) for k, v in row.items() if k.endswith("positions") or k.startswith("to_")}, time.time() - t)
