"""Openings and turns of random cabinets in a map; yourdfpy, trimesh and SciPy judge them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yourdfpy
from numpy.typing import NDArray

import semmap
from semmap import Database, Map
from semmap.geometry.pose import Pose
from semmap.manipulation.store.model_shapes import model_mesh
from tests.conftest import MakeDatabase
from tests.manipulation.cabinets import Cabinet
from tests.manipulation.grippers import urdf
from tests.seen import seen_by

Imported = Callable[[Cabinet], Map]


@pytest.fixture(scope="module")
def db(make_database: MakeDatabase) -> Iterator[Database]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        db.add_gripper(urdf("panda"), "panda")
        db.add_gripper(urdf("pr2"), "pr2")
        yield db


@pytest.fixture
def imported(db: Database, tmp_path: Path) -> Imported:
    def made(cabinet: Cabinet) -> Map:
        path = cabinet.write(tmp_path / "cabinet.urdf")
        name = f"map {len(db.maps)}"
        db.import_file(path, map=name)
        return db.map(name)

    return made


def part_poses(folder: Path, part: str, shares: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Where the part is at shares of its joint's way, by yourdfpy."""
    robot = yourdfpy.URDF.load(str(folder / "cabinet.urdf"), load_meshes=False)
    upper = robot.joint_map["moves"].limit.upper
    found = []
    for share in shares:
        robot.update_cfg({"moves": share * upper})
        found.append(np.array(robot.get_transform(part, "cabinet")))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_the_gripper_keeps_to_the_handle(imported: Imported, tmp_path: Path, seed: int) -> None:
    cabinet = Cabinet.random(seed)
    house = imported(cabinet)
    import time

    t = time.time()
    found = house.openings("handle" if cabinet.apart else cabinet.kind, gripper="panda", limit=40)
    print(cabinet, len(found), found.problems, time.time() - t)
    assert found.generated == [cabinet.kind]
    closed, opened = part_poses(tmp_path, cabinet.kind, np.array([0.0, 1.0]))
    for row in found:
        assert row["travel"] == pytest.approx(cabinet.travel, abs=1e-4)
        before = np.linalg.inv(closed) @ row["pose"].matrix
        after = np.linalg.inv(opened) @ row["end"].matrix
        assert np.allclose(before, after, atol=2e-5)
    t = time.time()
    print(house.practise(cabinet.kind, open_=True, gripper="panda"), time.time() - t)
    if cabinet.kind == "door":
        f = house.turns(cabinet.kind, gripper="panda")
        print("turns", len(f), f.problems)
        p = Pose.from_matrix(opened)
        house["door"].move_to(p.x, p.y, p.z, yaw=float(np.arctan2(opened[1, 0], opened[0, 0])))
        print(house["door"].holder)
        f = house.turns(cabinet.kind, gripper="panda")
        print("turns", len(f), f.problems)
        print(house.practise(cabinet.kind, turn=True, gripper="panda"))
