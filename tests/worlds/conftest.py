"""Where the real worlds lie."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def worlds() -> Path:
    """The folder of real worlds; tests that need it are skipped where it is absent."""
    default = Path(__file__).parents[3] / "shared" / "worlds"
    folder = Path(os.environ.get("SEMMAP_WORLDS", default))
    if not folder.is_dir():
        pytest.skip(f"no real worlds at {folder}: set SEMMAP_WORLDS")
    return folder
