"""The office of the examples in a database, and the command line on it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import Engine
from typer.testing import Result

from planner.live_topology import LiveTopology
from planner.robot_class import RobotClass
from semmap.query.map_handle import MapHandle
from tests.command_line import semmap
from tests.conftest import Import
from tests.office import OFFICE_FILES
from tests.office import delivery_robot as make_delivery_robot


class Commands:
    """The command line on a database."""

    def __init__(self, url: str) -> None:
        self.url = url

    def run(self, *words: object) -> Result:
        """What a command says; an error is raised."""
        return semmap(self.url, *words)


@pytest.fixture(scope="session")
def office_url(imported: Import) -> Iterator[str]:
    """A database that holds the office."""
    with imported(*((path, "office") for path in OFFICE_FILES)) as engine:
        yield engine.url.render_as_string(hide_password=False)


@pytest.fixture
def commands(office_url: str) -> Commands:
    """The command line, on the office."""
    return Commands(office_url)


@pytest.fixture
def office_engine(office_url: str) -> Iterator[Engine]:
    """An engine on the office."""
    from semmap.database import open_engine

    engine = open_engine(office_url)
    yield engine
    engine.dispose()


@pytest.fixture(scope="session")
def delivery_robot() -> RobotClass:
    """The robot of the example: a base, an arm and a pole."""
    return make_delivery_robot("tester")


@pytest.fixture(scope="session")
def office_live(office_url: str, delivery_robot: RobotClass) -> Iterator[LiveTopology]:
    """The topology of the office for that robot; nobody changes it."""
    from semmap.database import open_engine

    engine = open_engine(office_url)
    yield LiveTopology(MapHandle(engine, "office"), delivery_robot)
    engine.dispose()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """For what commands write."""
    return tmp_path / "out"
