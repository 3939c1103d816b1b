"""The wheel of `scripts/wheel` on a machine with Python alone, and the map in a container."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from zipfile import ZipFile

import pytest
from sqlalchemy import Engine

from tests.conftest import ROOT

pytestmark = pytest.mark.docker

IMAGE = """
FROM debian:bookworm-slim
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends python3-venv
RUN python3 -m venv /venv
"""
DEBIAN = (3, 11)
"""The Python of the image."""

THREE_LINES = """
import semmap; flat = semmap.connect(migrate=True).create_map("flat")
flat.add_room("kitchen", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.7)
print(flat.add_object("desk4", type="desk", size=(1.6, 0.8, 0.75), in_="kitchen").name)
"""
VOXELS = "SELECT ?o (COUNT(?v) AS ?n) { ?v :occupiedBy ?o ; :inRoom :kitchen } GROUP BY ?o"


def run(*command: object, text: str | None = None) -> str:
    done = subprocess.run(
        [str(part) for part in command], input=text, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def wheel() -> Path:
    if sys.version_info[:2] != DEBIAN:
        pytest.skip("the wheel of this Python is not for the container, which has Python 3.11")
    return ROOT / run(ROOT / "scripts/wheel").split()[-1]


def test_it_has_the_pages_of_the_viewer_and_of_queries(wheel: Path) -> None:
    names = ZipFile(wheel).namelist()
    assert {f"semmap/server/viewer/{page}.html" for page in ("index", "query")} <= {*names}


def test_it_has_the_source_of_the_image(wheel: Path) -> None:
    """`semmap db cluster` copies it."""
    in_wheel = "semmap/_data/docker/postgis/"
    names = {name for name in ZipFile(wheel).namelist() if name.startswith(in_wheel)}
    assert names - {in_wheel} == {
        f"{in_wheel}{file.name}" for file in (ROOT / "docker/postgis").iterdir()
    }


@pytest.fixture(scope="session")
def machine(docker: str, wheel: Path) -> Iterator[Callable[..., str]]:
    """Runs a command on a machine that had Python alone, and now has the wheel."""
    image = "semmap-python:test"
    run(docker, "build", "--network", "host", "-q", "-t", image, "-", text=IMAGE)
    options = ["--rm", "-d", "-i", "--network", "host", "-v", f"{wheel.parent}:/dist:ro"]
    if certificates := os.environ.get("PIP_CERT"):
        options += ["-v", f"{certificates}:/certificates:ro", "-e", "PIP_CERT=/certificates"]
    container = run(docker, "run", *options, image, "cat").strip()

    def run_there(*command: str, db: str = "", text: str | None = None) -> str:
        return run(docker, "exec", "-i", "-e", f"SEMMAP_DB={db}", container, *command, text=text)

    try:
        run_there("/venv/bin/pip", "install", "-q", f"/dist/{wheel.name}")
        yield run_there
    finally:
        run(docker, "rm", "-f", container)


def test_the_name_states_the_glibc_that_it_needs(wheel: Path) -> None:
    assert wheel.name.endswith("-cp311-cp311-manylinux_2_35_x86_64.whl")


def test_pip_install_and_three_lines(machine: Callable[..., str], docker_postgis: Engine) -> None:
    url = docker_postgis.url.set(drivername="postgresql").render_as_string(hide_password=False)
    assert "openvdb" not in machine("find", "/usr/lib", "-name", "*openvdb*")
    assert machine("/venv/bin/python", "-", db=url, text=THREE_LINES) == "desk4\n"
    semmap = "/venv/bin/semmap"
    assert "91 x 71 cells" in machine(semmap, "grid", "-o", "/tmp/flat", db=url)  # semmap_native
    found = json.loads(machine(semmap, "fields", "query", VOXELS, "--json", db=url))  # semmap_vdb
    assert found["rows"] == [["desk4", 32 * 16 * 15]]  # of 0.05 m
