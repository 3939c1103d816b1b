"""The real worlds in databases; the tests of a module share one and may change it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import Engine

import semmap
from planner.readers.robot_class import store_robot_class
from planner.robot_class import RobotClass
from semmap.robot import Part
from semmap.server.viewer_files import viewer_is_built
from tests.browser import chromium
from tests.conftest import Import

HOUSE = "small_house/worlds/small_house.world"
ROOMS = Path(__file__).parent / "small_house_rooms.geojson"
HOTEL = "rmf/hotel/hotel.building.yaml"
CLINIC = "rmf/clinic/clinic.building.yaml"


@pytest.fixture(scope="module")
def bare_house(imported: Import, worlds: Path) -> Iterator[Engine]:
    """An engine on the small house, without rooms."""
    with imported((worlds / HOUSE, "house")) as engine:
        yield engine


@pytest.fixture(scope="module")
def house(imported: Import, worlds: Path) -> Iterator[Engine]:
    """An engine on the small house and its rooms."""
    with imported((worlds / HOUSE, "house"), (ROOMS, "house")) as engine:
        yield engine


@pytest.fixture(scope="module")
def hotel(imported: Import, worlds: Path) -> Iterator[Engine]:
    """An engine on the hotel."""
    with imported((worlds / HOTEL, "hotel")) as engine:
        yield engine


@pytest.fixture(scope="module")
def clinic(imported: Import, worlds: Path) -> Iterator[Engine]:
    """An engine on the clinic."""
    with imported((worlds / CLINIC, "clinic")) as engine:
        yield engine


@pytest.fixture(scope="module")
def house_and_hotel(imported: Import, worlds: Path) -> Iterator[Engine]:
    """An engine on the small house with its rooms, and the hotel."""
    files = (worlds / HOUSE, "house"), (ROOMS, "house"), (worlds / HOTEL, "hotel")
    with imported(*files) as engine:
        yield engine


@pytest.fixture(scope="module")
def db(house: Engine) -> Iterator[semmap.Database]:
    """The database of the small house."""
    with semmap.connect(house.url.render_as_string(hide_password=False)) as db:
        yield db


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if shutil.which("chromium") is None:
        pytest.skip("needs chromium, which scripts/setup test installs on Debian alone")
    assert viewer_is_built(), "scripts/setup test builds the page"
    with chromium() as browser:
        yield browser


def store_slim_robot(engine: Engine) -> str:
    """Store a class of robots that gets between the chairs of the small house; its name."""
    corners = 0.15 * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    part = Part("base", ("base",), (0.05, 1.0), corners, 0.15, 0.22)
    with engine.begin() as connection:
        store_robot_class(connection, RobotClass("slim", (part,)))
    return "slim"
