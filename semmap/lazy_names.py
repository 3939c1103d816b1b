"""Names of a package that are loaded when they are first used, so that a short command is quick."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

from semmap.syntax_tree import parse_module


def load_on_use(package: str) -> tuple[Callable[[str], Any], list[str]]:
    """Return ``__getattr__`` and ``__all__`` of a package whose names are in other modules.

    They are those that its source imports for type checkers alone, ``if TYPE_CHECKING:``. ``dir``
    lists them, too.

    >>> load, names = load_on_use("semmap")
    >>> "Pose" in names, load("Pose").__name__
    (True, 'Pose')
    >>> load("Posse")
    Traceback (most recent call last):
    AttributeError: module 'semmap' has no attribute 'Posse'
    """
    module = sys.modules[package]
    homes = {
        alias.name: str(node.module)
        for block in parse_module(module.__loader__.get_source(package)).body  # type: ignore[union-attr]
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return vars(module).setdefault(name, getattr(import_module(homes[name]), name))

    vars(module)["__dir__"] = lambda: sorted({*vars(module), *homes})
    return load, sorted(homes)
