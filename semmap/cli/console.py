"""A console of rich on which no printed name controls the terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from semmap.terminal import has_control, visible


class SafeConsole(Console):
    """A console that controls the terminal by itself alone, not by what it prints."""

    def render_str(self, text: str, **options: Any) -> Text:
        """A text as it is laid out: control characters take the room of their escapes."""
        return super().render_str(visible(text), **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """The parts of what is printed; a text that has control characters loses its styles."""
        if isinstance(renderable, Text) and has_control(renderable.plain):
            renderable = renderable.blank_copy(visible(renderable.plain))
        return super().render(renderable, options)
