"""From the text of the paper to SPARQL.

The examples of reMap (section 4) have IRIs without angle brackets, WHERE without braces and names
without a colon. What is SPARQL already stays as it is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from semmap.language.error import QueryError
from semmap.limits import QUERY_CHARACTERS, QUERY_WORDS

__all__ = ["Normalised", "normalise"]

_TOKEN = re.compile(
    r"""
      (?P<space>\s+)
    | (?P<comment>\#[^\n\r]*)
    | (?P<iri><[^<>"{}|^`\\\x00-\x20]*>)
    | (?P<string>\"{3}(?:"{0,2}(?:[^"\\]|\\.))*\"{3} | '{3}(?:'{0,2}(?:[^'\\]|\\.))*'{3}
               | "(?:[^"\n\r\\]|\\.)*" | '(?:[^'\n\r\\]|\\.)*')
    | (?P<variable>[?$]\w+)
    | (?P<blank>_:\w+(?:[.-]+\w+)*)
    | (?P<language>@[A-Za-z]+(?:-[A-Za-z0-9]+)*)
    | (?P<prefixed>(?:[^\W\d_]\w*(?:[.-]+\w+)*)?:(?:(?:[\w:%-]|\\[^\w\s]|\.(?=[\w:%.\\-]))*))
    | (?P<number>(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)
    | (?P<word>[^\W\d]\w*(?:[.-]+\w+)*)
    | (?P<other>.)
    """,
    re.VERBOSE | re.DOTALL,
)
_BARE_PREFIX = re.compile(r"PREFIX\s+[^\s:<]*:\s*(?P<iri>[^\s<]\S*)", re.IGNORECASE)
_BARE_BASE = re.compile(r"BASE\s+(?P<iri>[^\s<]\S*)", re.IGNORECASE)
_BRACKET = re.compile(r"\s*[({]")
_ESCAPE = re.compile(r"(?<!\\)\\(?:u([0-9A-Fa-f]{4})|U([0-9A-Fa-f]{8}))")

_MODIFIERS = frozenset(["STORE", "AT", "DURING", "GROUP", "HAVING", "ORDER", "LIMIT", "OFFSET"])
"""Words that end a WHERE without braces."""

_RESERVED = _MODIFIERS | {
    *("A", "ADD", "ALL", "AS", "ASC", "ASK", "BASE", "BIND", "BY", "CLEAR", "CONSTRUCT", "COPY"),
    *("CREATE", "DATA", "DEFAULT", "DELETE", "DESC", "DESCRIBE", "DISTINCT", "DROP", "EXISTS"),
    *("FALSE", "FILTER", "FROM", "GRAPH", "IN", "INSERT", "INTO", "LOAD", "MINUS", "MOVE"),
    *("NAMED", "NOT", "OPTIONAL", "PREFIX", "REDUCED", "SELECT", "SEPARATOR", "SERVICE", "SILENT"),
    *("TO", "TRUE", "UNDEF", "UNION", "USING", "VALUES", "WHERE", "WITH"),
}
"""All words of the grammar that can stand without an opening bracket after them."""


Edit = tuple[int, int, str]
"""What stands in place of the characters from the first number to the second."""


@dataclass(frozen=True)
class Normalised:
    """A text in SPARQL, and where its parts stood in what the user wrote."""

    text: str
    source: str
    steps: tuple[tuple[Edit, ...], ...]

    def offset(self, position: int) -> int:
        """The place in the source of a place in the text."""
        for edits in reversed(self.steps):
            position = _before(edits, position)
        return position


def normalise(source: str) -> Normalised:
    """A text as SPARQL.

    Raises
    ------
    QueryError
        It is longer than `semmap.limits` allow.
    """

    def refused(problem: str, fix: str) -> QueryError:
        return QueryError(f"the text {problem}. {fix}", source, 0)

    QUERY_CHARACTERS.check(len(source), refused, "Ask for less at a time.")
    steps, text = [], source
    for find in (_escapes, lambda text: _insertions(text, refused)):
        edits = tuple(find(text))
        text = _edited(text, edits)
        steps.append(edits)
    return Normalised(text, source, tuple(steps))


def _edited(text: str, edits: Iterable[Edit]) -> str:
    parts, done = [], 0
    for begin, end, new in edits:
        parts += [text[done:begin], new]
        done = end
    return "".join([*parts, text[done:]])


def _before(edits: Iterable[Edit], position: int) -> int:
    """Where a place in an edited text was before."""
    shift = 0
    for begin, end, new in edits:
        if position < begin + shift:
            break
        if position < begin + shift + len(new):
            return begin
        shift += len(new) - (end - begin)
    return position - shift


def _escapes(text: str) -> Iterator[Edit]:
    """Code points written as numbers, which SPARQL allows anywhere (SPARQL 1.1, section 19.2)."""
    for match in _ESCAPE.finditer(text):
        number = int(match[1] or match[2], 16)
        if number <= 0x10FFFF:
            yield match.start(), match.end(), chr(number)


def _insertions(text: str, refused: Callable[[str, str], QueryError]) -> Iterator[Edit]:
    """Brackets and colons that the paper leaves out."""
    depth = 0
    opened: list[int] = []  # the depths at which a WHERE without braces began
    last = 0  # the end of what came last
    previous = ""
    position = count = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        assert match is not None
        position = match.end()
        kind, token = match.lastgroup, match[0]
        if kind in ("space", "comment"):
            continue
        if kind == "other" and token in "\"'":
            break  # nothing closes it; the grammar says so
        count += 1
        QUERY_WORDS.check(count, refused, "Ask for less at a time.")
        word = token.upper() if kind == "word" else ""
        if previous == "WHERE" and token != "{":
            yield last, last, " {"
            opened.append(depth)
        if opened and depth == opened[-1] and (word in _MODIFIERS or token == "}"):
            yield last, last, " }"
            opened.pop()
        depth += {"{": 1, "(": 1, "}": -1, ")": -1}.get(token, 0)
        declared = {"PREFIX": _BARE_PREFIX, "BASE": _BARE_BASE}.get(word)
        bare = declared.match(text, match.start()) if declared else None
        if bare:
            yield bare.start("iri"), bare.start("iri"), "<"
            yield bare.end("iri"), bare.end("iri"), ">"
            position = bare.end()
        elif word and word not in _RESERVED and not _BRACKET.match(text, position):
            yield match.start(), match.start(), ":"
        previous, last = word, position
    if previous == "WHERE":
        return
    for _ in opened:
        yield last, last, " }"
