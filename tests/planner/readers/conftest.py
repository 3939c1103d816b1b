"""A connection on the office that leaves nothing behind."""

from collections.abc import Iterator

import pytest
from sqlalchemy import Connection, Engine

from semmap.database.maps import see_map


@pytest.fixture
def connection(office_engine: Engine) -> Iterator[Connection]:
    with office_engine.connect() as connection:
        see_map(connection, "office")
        yield connection
        connection.rollback()
