"""What the tests of manipulation share."""

import pytest

from tests.manipulation import rooms
from tests.manipulation.cup_map import cup_map, cups
from tests.manipulation.house_map import house, house_map

__all__ = ["cup_map", "cups", "house", "house_map"]


@pytest.fixture(scope="session")
def kitchen(worlds):
    return rooms.kitchen(worlds)
