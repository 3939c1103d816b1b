"""What the tests of manipulation share."""

import pytest

from tests.manipulation import rooms


@pytest.fixture(scope="session")
def kitchen(worlds):
    return rooms.kitchen(worlds)
