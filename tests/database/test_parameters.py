"""What a user reads where there is no connection."""

from __future__ import annotations

import pytest

from semmap.database.parameters import unreachable
from tests.soak.disk import fill, small_disk


def test_a_full_disk_is_named() -> None:
    with small_disk(megabytes=1) as disk:
        if disk is None:
            pytest.skip("only root can mount a disk")
        assert "Is the server running" in unreachable("a map", str(disk), "could not write")
        fill(disk)
        message = unreachable("a map", str(disk), "could not write")
    assert message.endswith(f"could not write. The disk of {disk} is full: make room on it.")
