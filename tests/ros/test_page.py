"""The client of docs/ros.md gets the grid and a path over storeys."""

from __future__ import annotations

import subprocess

from sqlalchemy import Engine

import semmap
from tests.examples.test_api_page import BLOCK, ROOT
from tests.ros.conftest import RunNode


def test_the_client_of_the_page_gets_answers(
    run_node: RunNode, office_world: Engine, ros_python: str, ros_environment: dict[str, str]
) -> None:
    (example,) = BLOCK.findall((ROOT / "docs/ros.md").read_text())
    url = office_world.url.set(drivername="postgresql").render_as_string(hide_password=False)
    with run_node(url, "office"):
        told = subprocess.run(
            [ros_python, "-c", example],
            env=ros_environment,
            capture_output=True,
            text=True,
            timeout=180,
        )
    assert told.returncode == 0, told.stderr
    width, height, occupied, poses, z = map(float, told.stdout.split())
    with semmap.connect(url) as db:
        grid = db.map("office").grid("floor-1st")
    assert (height, width) == grid.grid.shape
    assert occupied == (grid.cells == 100).sum()
    assert poses > 10
    assert z == 7
