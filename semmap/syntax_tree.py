"""Syntax trees of Python source, from any thread.

Before Python 3.11.5, two threads that parse at once fail with a SystemError (CPython gh-106905).
"""

from __future__ import annotations

import ast
from threading import Lock

_ONE = Lock()


def parse_module(source: str | bytes) -> ast.Module:
    """Return the tree of a module."""
    with _ONE:
        return ast.parse(source)


def parse_expression(source: str) -> ast.expr:
    """Return the tree of an expression.

    >>> type(parse_expression("a | None")).__name__
    'BinOp'
    """
    with _ONE:
        return ast.parse(source, mode="eval").body
