"""The office of the examples in a database, and the command line on it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import Engine
from typer.testing import Result

from navgrid.options import parts_of
from planner.demo import office_files
from planner.live import Live
from planner.robot_class import RobotClass
from semmap.ingest.importer import import_file
from tests.command_line import semmap
from tests.conftest import MakeDatabase


class Commands:
    """The command line on a database."""

    def __init__(self, url: str) -> None:
        self.url = url

    def run(self, *words: object) -> Result:
        """What a command says; an error is raised."""
        return semmap(self.url, *words)


@pytest.fixture(scope="session")
def office_url(make_database: MakeDatabase) -> str:
    """A database that holds the office."""
    from semmap.database import connect

    url = make_database()
    engine = connect(url)
    for path in office_files():
        import_file(engine, path, map_name="office")
    engine.dispose()
    return url.render_as_string(hide_password=False)


@pytest.fixture
def commands(office_url: str) -> Commands:
    """The command line, on the office."""
    return Commands(office_url)


@pytest.fixture
def office_engine(office_url: str) -> Iterator[Engine]:
    """An engine on the office."""
    from semmap.database import connect

    engine = connect(office_url)
    yield engine
    engine.dispose()


@pytest.fixture(scope="session")
def delivery_robot() -> RobotClass:
    """The robot of the example: a base, an arm and a pole."""
    folder = office_files()[0].parent
    parts = parts_of(folder / "delivery_robot.urdf", None, folder / "delivery_robot_parts.yaml")
    return RobotClass("tester", tuple(parts), speed=0.8)


@pytest.fixture(scope="session")
def office_live(office_url: str, delivery_robot: RobotClass) -> Iterator[Live]:
    """The topology of the office for that robot; nobody changes it."""
    from semmap.database import connect

    engine = connect(office_url)
    yield Live(engine, "office", delivery_robot)
    engine.dispose()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """For what commands write."""
    return tmp_path / "out"
