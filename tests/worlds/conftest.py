"""The real worlds in databases; the tests of a module share one and may change it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import Engine

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
