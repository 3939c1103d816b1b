"""Names of a package that are loaded when they are first used, so that a short command is quick."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def load_on_use(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package whose names are in other modules: `homes` by name.

    >>> load = load_on_use("semmap", {"Pose": "semmap.geometry.pose"})
    >>> load("Pose").__name__
    'Pose'
    >>> load("Posse")
    Traceback (most recent call last):
    AttributeError: module 'semmap' has no attribute 'Posse'
    """

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = getattr(import_module(homes[name]), name)
        return vars(sys.modules[package]).setdefault(name, found)

    return load
