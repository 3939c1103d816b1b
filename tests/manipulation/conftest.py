"""What the tests of manipulation share."""

import pytest

from tests.manipulation import rooms
from tests.manipulation.cup_map import cup_map, cups

__all__ = ["cup_map", "cups"]


@pytest.fixture(scope="session")
def kitchen(worlds):
    return rooms.kitchen(worlds)
