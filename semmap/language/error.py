"""The error for a query or update that cannot be carried out, with its place in the text."""

from __future__ import annotations

from semmap.error import Error

TOO_DEEP = "this is nested too deeply, or has too many parts: use fewer brackets and UNIONs"
"""The reason for refusing a text that exceeds Python's limit of recursion."""

WIDEST = 200  # the most characters of a line that are shown on either side of an error


class QueryError(Error, ValueError):
    """A query or update is wrong; nothing was changed. Line and column count from 1.

    >>> print(QueryError("use SELECT", "SELCT ?v { }", 0))
    line 1, column 1: use SELECT
        SELCT ?v { }
        ^
    """

    def __init__(self, reason: str, text: str, offset: int) -> None:
        offset = min(max(offset, 0), len(text))
        begin = text.rfind("\n", 0, offset) + 1
        end = text.find("\n", offset)
        shown = text[begin : len(text) if end < 0 else end].rstrip("\r")
        self.reason = reason
        self.line = text.count("\n", 0, offset) + 1
        self.column = offset - begin + 1
        if self.column > WIDEST or len(shown) > 2 * WIDEST:
            first = max(0, self.column - WIDEST)
            shown, offset = shown[first : self.column + WIDEST], offset - first
        # Tabs stay tabs, so that the caret stands below its character.
        margin = "".join(c if c == "\t" else " " for c in shown[: offset - begin])
        super().__init__(
            f"line {self.line}, column {self.column}: {reason}\n    {shown}\n    {margin}^"
        )
