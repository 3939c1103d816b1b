"""What is printed: names come from anybody, and none of them controls the terminal."""

from __future__ import annotations

import os
import re
import sys
from typing import Any

_CONTROL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # all control characters but tab and line feed
    "\u202a-\u202e\u2066-\u2069"  # what changes the direction of text
    "\ud800-\udfff]"  # parts of file names that are not UTF-8, which no stream takes
)


def visible(text: str) -> str:
    r"""A text whose control characters but line feeds and tabs are written as Python writes them.

    >>> print(visible("mug\x1b[2J\u202e"))
    mug\x1b[2J\u202e
    """
    if text.isprintable():
        return text
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def has_control(text: str) -> bool:
    """Whether a text has control characters."""
    return _CONTROL.search(text) is not None


def print_bold(text: str) -> None:
    """Print a line whose control characters are visible, in bold on a terminal that has styles."""
    stream = getattr(sys.stdout, "rich_proxied_file", sys.stdout)
    styled = stream.isatty() and "NO_COLOR" not in os.environ and os.environ.get("TERM") != "dumb"
    stream.write(f"\x1b[1m{visible(text)}\x1b[0m\n" if styled else f"{visible(text)}\n")


def print_waiting(text: str) -> None:
    """Print a line on standard error if that is a terminal, where a person waits."""
    if sys.stderr is not None and sys.stderr.isatty():
        print(visible(text), file=sys.stderr, flush=True)


class SafeStream:
    """A stream for `print`; a console of rich, whose control sequences are its own, passes by it.

    rich finds the stream beneath by the name `rich_proxied_file`.
    """

    def __init__(self, stream: Any) -> None:
        self.rich_proxied_file = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)

    def write(self, text: str) -> int:
        """Write a text with its control characters made visible."""
        self.rich_proxied_file.write(visible(text))
        return len(text)


def guard_streams() -> None:
    """From now on, `print`, warnings and tracebacks of this process write visible text alone."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is not None and not isinstance(stream, SafeStream):
            setattr(sys, name, SafeStream(stream))
