"""The sentences of a JSGF grammar, read by the tests alone."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

SIGNS = {"<": ">", "[": "]", "(": ")"}


def generated(jsgf: str, only: Mapping[str, Sequence[str]] | None = None) -> list[str]:
    """All sentences of a grammar without recursion, with some of the words of a rule `only`."""
    lines = re.findall(r"^(?:public )?<(\w+)> = (.*);$", jsgf, re.MULTILINE)
    rules = {name: body.split(" | ") for name, body in lines}
    for name, words in (only or {}).items():
        assert {*words} <= {*rules[name]}, name
        rules[name] = [*words]
    forms = re.split(r" \| (?![^(]*\))", dict(lines)["command"])  # not within a choice
    return [" ".join(text.split()) for form in forms for text in _expanded(form, rules)]


def _expanded(text: str, rules: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """The texts of a sequence of words, rules, options and choices."""
    begin = next((i for i, sign in enumerate(text) if sign in SIGNS), None)
    if begin is None:
        yield text
        return
    sign = text[begin]
    end = text.index(SIGNS[sign], begin)
    inner = text[begin + 1 : end]
    words = rules[inner] if sign == "<" else inner.split(" | ")
    for word in [*words, *([""] if sign == "[" else [])]:
        for rest in _expanded(text[end + 1 :], rules):
            yield text[:begin] + word + rest
