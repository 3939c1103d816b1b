"""What is printed: names come from anybody, and none of them controls the terminal."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.file_proxy import FileProxy
from rich.segment import Segment
from rich.text import Text

__all__ = ["SafeConsole", "guard_streams", "visible"]

_CONTROL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # all control characters but tab and line feed
    "\u202a-\u202e\u2066-\u2069"  # what changes the direction of text
    "\ud800-\udfff]"  # parts of file names that are not UTF-8, which no stream takes
)


def visible(text: str) -> str:
    r"""A text whose control characters are written as Python writes them.

    Line feeds and tabs stay.

    Examples
    --------
    >>> print(visible("mug\x1b[2J\u202e"))
    mug\x1b[2J\u202e
    """
    if text.isprintable():
        return text
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


class SafeConsole(Console):
    """A console that controls the terminal by itself alone, not by what it prints."""

    def render_str(self, text: str, **options: Any) -> Text:
        """A text as it is laid out: control characters take the room of their escapes."""
        return super().render_str(visible(text), **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """The parts of what is printed; a text that has control characters loses its styles."""
        if isinstance(renderable, Text) and _CONTROL.search(renderable.plain):
            renderable = renderable.blank_copy(visible(renderable.plain))
        return super().render(renderable, options)


class SafeStream(FileProxy):
    """A stream for `print`; a console, whose control sequences are its own, writes past it."""

    def write(self, text: str) -> int:
        """Write a text with its control characters made visible."""
        self.rich_proxied_file.write(visible(text))
        return len(text)

    def flush(self) -> None:
        """Write out what waits."""
        self.rich_proxied_file.flush()

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return self.rich_proxied_file.isatty()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """How text is written."""
        return str(getattr(self.rich_proxied_file, "encoding", "utf-8"))


def guard_streams() -> None:
    """From now on, `print`, warnings and tracebacks of this process write visible text alone."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is not None and not isinstance(stream, SafeStream):
            setattr(sys, name, SafeStream(Console(), stream))
