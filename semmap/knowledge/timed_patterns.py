"""Patterns of SHACL with a limit of time: Python's take exponential time for some, unstoppably."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import regex

from semmap.limits import REGEX_SECONDS


@dataclass(frozen=True)
class _Timed:
    pattern: regex.Pattern[str]

    def match(self, text: str) -> Any:
        return self.pattern.match(text, timeout=REGEX_SECONDS.value)

    def search(self, text: str) -> Any:
        return self.pattern.search(text, timeout=REGEX_SECONDS.value)


class TimedPatterns:
    """The part of `re` that pySHACL uses; TimeoutError after `REGEX_SECONDS` for one text."""

    I, M = regex.I, regex.M  # noqa: E741 - as pySHACL calls them

    @staticmethod
    def compile(pattern: str, flags: int) -> _Timed:
        """Return a pattern that matches for a limited time."""
        return _Timed(regex.compile(pattern, flags))
