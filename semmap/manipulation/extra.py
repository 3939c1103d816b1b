"""The libraries of `semmap[manipulation]`, imported where they are used."""

from __future__ import annotations

import importlib
from typing import Any

from semmap.manipulation.error import ManipulationError


def library(name: str) -> Any:
    """A module of the extra; ManipulationError says how to install it where it is not."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ManipulationError(
            f"{name} is not installed; install the extra: pip install 'semmap[manipulation]'"
        ) from error
