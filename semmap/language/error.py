"""What is refused, and where in the text."""

from __future__ import annotations

__all__ = ["QueryError"]


WIDEST = 200
"""Characters that are shown of a line before the place of an error, and behind it."""


class QueryError(ValueError):
    """A text that cannot be answered; nothing was changed.

    Parameters
    ----------
    reason : what is wrong, and how to mend it
    text : the text as the user wrote it
    offset : of the character that is wrong, from 0

    Attributes
    ----------
    line, column : the place, both from 1
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
