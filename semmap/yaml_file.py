"""YAML files that people write, read with the caller's type of error."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from semmap.limits import CONFIG_BYTES, ELEMENTS, NESTING

FAST: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""For large files; the other loader locates mistakes better."""

_DIGITS = re.compile(r"[-+.:_0-9a-fA-FxoO]{1000,}")
"""Numbers of so many digits, which take quadratic time to read."""


def read_text(path: Path | str, what: str, error: type[Exception]) -> str:
    """Return the text of a file; an `error` asks for `what` it should be."""
    try:
        CONFIG_BYTES.check(
            Path(path).stat().st_size,
            lambda problem, fix: error(f"{path}: {problem}. {fix}"),
            f"Name {what}.",
        )
        return Path(path).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise error(f"{path}: cannot be read: {problem}. Name {what}") from None


def parse_yaml(text: str, file: str, error: type[Exception]) -> Any:
    """Return the content of YAML text; `file` names it in an `error`."""

    def refused(line: int, problem: str, fix: str) -> Exception:
        return error(f"{file}: is not valid YAML: line {line} {problem}. {fix}")

    try:
        check_structure(text, refused)
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        if isinstance(problem, error):
            raise
        raise error(f"{file}: is not valid YAML: {problem}") from None


def check_structure(
    text: str,
    error: Callable[[int, str, str], Exception],
    *,
    loader: type[yaml.SafeLoader] = yaml.SafeLoader,
    aliases: bool = True,
) -> None:
    """Refuse YAML text that is nested too deeply, or that aliases unfold to too many values.

    `error` makes an exception of the line, the problem and how to fix it. `loader` reads the text
    later. yaml.YAMLError if it is not YAML.
    """
    sizes: dict[str, int] = {}  # values in what an anchor marks
    open_: list[tuple[str | None, int]] = []  # its anchor, and the values before it
    total = 0
    for event in yaml.parse(text, Loader=loader):
        line = event.start_mark.line + 1 if event.start_mark else 1

        def refused(problem: str, fix: str, line: int = line) -> Exception:
            return error(line, problem, fix)

        if isinstance(event, yaml.CollectionStartEvent):
            open_.append((event.anchor, total))
            NESTING.check(len(open_), refused, "Make it flatter.", "nests")
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_.pop()
            if anchor is not None:
                sizes[anchor] = total - before
        elif isinstance(event, yaml.AliasEvent):
            if not aliases:
                raise refused(f"has an alias (*{event.anchor})", "Write the value out.")
            if event.anchor not in sizes:
                raise refused(f"has an alias *{event.anchor} that contains itself", "Remove it.")
            total += sizes[event.anchor]
        elif isinstance(event, yaml.ScalarEvent):
            total += 1
            if event.anchor is not None:
                sizes[event.anchor] = 1
            if not event.style and _DIGITS.fullmatch(event.value):
                raise refused(f"has a number of {len(event.value)} digits", "Shorten it.")
        ELEMENTS.check(total, refused, "Say less, or use fewer aliases.")
