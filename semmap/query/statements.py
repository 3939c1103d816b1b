"""Which SQL statements only read: the kind of a statement, by its first word."""

from __future__ import annotations

import re

READING = ("SELECT", "WITH", "VALUES", "TABLE", "EXPLAIN", "SHOW")
"""Statements that return rows and, in a transaction that only reads, change nothing."""

_SPACE = re.compile(r"(?:[\s;(]|--[^\r\n]*)*")
_WORD = re.compile(r"[^\W\d]\w*")
_COMMENT = re.compile(r"/\*|\*/")


def kind(statement: str) -> str:
    """The first word of a statement in capitals; empty if it does not begin with a word.

    Comments, semicolons and parentheses before it do not count.

    >>> kind("/* a /* b */ */ (select 1)")
    'SELECT'
    """
    position = 0
    while True:
        position = _match_end(_SPACE, statement, position)
        if not statement.startswith("/*", position):
            break
        depth = 0
        for mark in _COMMENT.finditer(statement, position):
            depth += 1 if mark[0] == "/*" else -1
            if depth == 0:
                position = mark.end()
                break
        else:
            return ""
    word = _WORD.match(statement, position)
    return word[0].upper() if word else ""


def _match_end(pattern: re.Pattern[str], text: str, position: int) -> int:
    match = pattern.match(text, position)
    return position if match is None else match.end()
