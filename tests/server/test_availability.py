"""A database that is known to be away is not waited for."""

from __future__ import annotations

import socket
import time

import pytest
from sqlalchemy import make_url

from semmap.database import DatabaseError
from semmap.server.availability import Availability


def test_a_silent_server_is_waited_for_once() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        availability = Availability(make_url(f"postgresql+psycopg://a@127.0.0.1:{port}/b"))
        for most in (5, 0.5, 0.5):
            began = time.monotonic()
            with pytest.raises(DatabaseError, match="does not answer"):
                availability.check()
            assert time.monotonic() - began < most
        availability.close()
