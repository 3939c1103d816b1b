"""Rewrites the notation of reMap (section 4) as SPARQL, and keeps track of positions.

The paper writes IRIs without angle brackets, WHERE without braces and names without a colon.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from semmap.language.error import QueryError
from semmap.limits import NO_CHARACTER, QUERY_CHARACTERS, QUERY_WORDS

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
"""The keywords that end a WHERE without braces."""

_RESERVED = _MODIFIERS | {
    *("A", "ADD", "ALL", "AS", "ASC", "ASK", "BASE", "BIND", "BY", "CLEAR", "CONSTRUCT", "COPY"),
    *("CREATE", "DATA", "DEFAULT", "DELETE", "DESC", "DESCRIBE", "DISTINCT", "DROP", "EXISTS"),
    *("FALSE", "FILTER", "FROM", "GRAPH", "IN", "INSERT", "INTO", "LOAD", "MINUS", "MOVE"),
    *("NAMED", "NOT", "OPTIONAL", "PREFIX", "REDUCED", "SELECT", "SEPARATOR", "SERVICE", "SILENT"),
    *("TO", "TRUE", "UNDEF", "UNION", "USING", "VALUES", "WHERE", "WITH"),
}
"""The keywords that need no opening bracket after them."""

Edit = tuple[int, int, str]  # begin and end of the replaced characters, and the new ones


@dataclass(frozen=True)
class NormalisedText:
    """A text as SPARQL, and how its positions map to the text that the user wrote."""

    sparql: str  # the text as SPARQL
    original: str  # the text as the user wrote it
    # the edits from `original` to `sparql`, one tuple for each pass
    steps: tuple[tuple[Edit, ...], ...]

    def offset(self, position: int) -> int:
        """Return the index in `original` of a position in `sparql`."""
        for edits in reversed(self.steps):
            position = _before(edits, position)
        return position

    def error(self, reason: str, position: int) -> QueryError:
        """Return an error at the first word from a position in `sparql` on."""
        return QueryError(reason, self.original, self.offset(skip_space(self.sparql, position)))


def normalise(text: str) -> NormalisedText:
    """Rewrite a text as SPARQL; raises QueryError if it is longer than `semmap.limits` allow.

    >>> normalise("SELECT ?v WHERE ?v :inRoom kitchen").sparql
    'SELECT ?v WHERE { ?v :inRoom :kitchen }'
    """

    def too_long(problem: str, fix: str) -> QueryError:
        return QueryError(f"the text {problem}. {fix}", text, 0)

    fix = "Split it into several queries."
    QUERY_CHARACTERS.check(len(text), too_long, fix)

    def check_words(count: int) -> None:
        QUERY_WORDS.check(count, too_long, fix)

    steps, sparql = [], text
    for find_edits in (_escapes, lambda text: _insertions(text, check_words)):
        edits = tuple(find_edits(sparql))
        sparql = _edited(sparql, edits)
        steps.append(edits)
    normalised = NormalisedText(sparql, text, tuple(steps))
    if wrong := NO_CHARACTER.search(sparql):
        raise normalised.error(
            f"U+{ord(wrong[0]):04X} is not a character: leave it out", wrong.start()
        )
    return normalised


def tokens(text: str) -> Iterator[tuple[str, int, int]]:
    """Yield the kind, begin and end of each token of a text, as this module reads it."""
    for match in _TOKEN.finditer(text):
        yield match.lastgroup or "other", match.start(), match.end()


def skip_space(text: str, position: int) -> int:
    """Return the first position from there on that is neither space nor in a comment."""
    while position < len(text) and (text[position].isspace() or text[position] == "#"):
        if text[position] == "#":
            position = text.find("\n", position) + 1 or len(text)
        else:
            position += 1
    return position


def _edited(text: str, edits: Iterable[Edit]) -> str:
    parts, done = [], 0
    for begin, end, new in edits:
        parts += [text[done:begin], new]
        done = end
    return "".join([*parts, text[done:]])


def _before(edits: Iterable[Edit], position: int) -> int:
    """Return the position before the edits of a position after them."""
    shift = 0
    for begin, end, new in edits:
        if position < begin + shift:
            break
        if position < begin + shift + len(new):
            return begin
        shift += len(new) - (end - begin)
    return position - shift


def _escapes(text: str) -> Iterator[Edit]:
    r"""Replace code points such as \u0041, which are allowed anywhere (SPARQL 1.1, 19.2)."""
    for match in _ESCAPE.finditer(text):
        number = int(match[1] or match[2], 16)
        if number <= 0x10FFFF:
            yield match.start(), match.end(), chr(number)


def _insertions(text: str, check_words: Callable[[int], None]) -> Iterator[Edit]:
    """Insert the brackets, braces and colons that the paper leaves out."""
    depth = 0
    opened: list[int] = []  # the depths at which a WHERE without braces began
    last = 0  # the end of the last token
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
            break  # an open string: the grammar reports it
        count += 1
        check_words(count)
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
