"""A grammar of the names that a map knows, for speech recognisers and language models."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from semmap.belief.error import BeliefError

FORMATS = ("gbnf", "jsgf")

WHERE = "where is {the} <thing>"
WHERE_AT = "where is {the} <thing> at <hour>"
WHICH = "which <group> was {relation} {the} <place> yesterday"
FIND = "find {the} <thing>"
BRING = "bring {the} <thing> to {the} <place>"
GO = "go to {the} <place>"
PLACED = "{the} <thing> is {relation} {the} <place>"
THING_IS_A = "{the} <thing> is {a} <type>"
TYPE_IS_A = "{a} <type> is {a} <type>"
ACTION = "<action>"
WHERE_ANY, FIND_ANY, BRING_ANY, WHERE_ANY_AT = (
    form.replace("thing", "kind") for form in (WHERE, FIND, BRING, WHERE_AT)
)

SENTENCES = (
    WHERE,
    FIND,
    BRING,
    GO,
    PLACED,
    THING_IS_A,
    TYPE_IS_A,
    ACTION,
    WHERE_ANY,
    FIND_ANY,
    BRING_ANY,
    WHERE_AT,
    WHERE_ANY_AT,
    WHICH,
)
"""The sentences; ``<x>`` is a name, ``{x}`` one of `CHOICES`."""

STATEMENTS = (PLACED, THING_IS_A, TYPE_IS_A)
"""Those that teach; the others ask for an answer, a plan or a route."""

CHOICES = {"the": ("", "the"), "a": ("a", "an"), "relation": ("in", "on")}
"""The words that may stand for ``{x}``; an empty one may be left out."""

LISTS = {
    "thing": "things",
    "place": "places",
    "type": "types",
    "action": "actions",
    "kind": "kinds",
    "group": "groups",
    "hour": "hours",
}

NUMBERS = ["one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven"]
HOURS = (
    "midnight",
    *(f"{number} in the morning" for number in NUMBERS),
    "noon",
    *(f"{number} in the afternoon" for number in NUMBERS[:5]),
    *(f"{number} in the evening" for number in NUMBERS[5:9]),
    *(f"{number} at night" for number in NUMBERS[9:]),
)
"""The hours of the day, from midnight on."""


def write_grammar(names: Mapping[str, Sequence[str]], format: str = "gbnf") -> str:
    """Return a grammar of commands and teachings about the names of a map.

    `names` has `things`, `places`, `types`, `actions`, `groups`, the types of the things, `kinds`,
    those that stand for any of them, and `hours`; sentences about an empty list are left out.
    `BeliefError` if the format is none of `FORMATS`, or there are no names at all.

    Examples
    --------
    >>> print(write_grammar({"things": ["coke1"], "places": []}, "jsgf"))
    #JSGF V1.0;
    grammar semmap;
    public <command> = where is [the] <thing> | find [the] <thing>;
    <thing> = coke 1;
    """
    if format not in FORMATS:
        raise BeliefError(f"the grammar {format} is not one of {', '.join(FORMATS)}")
    words = {
        rule: sorted({spoken(name) for name in names.get(part, ())} - {""})
        for rule, part in LISTS.items()
    }
    sentences = [
        sentence
        for sentence in SENTENCES
        if all(words[rule] for rule in re.findall(r"<(\w+)>", sentence))
    ]
    if not sentences:
        raise BeliefError("the map has no names: import a world, or teach objects")
    used = {rule for sentence in sentences for rule in re.findall(r"<(\w+)>", sentence)}
    lists = {rule: words[rule] for rule in LISTS if rule in used}
    return _jsgf(sentences, lists) if format == "jsgf" else _gbnf(sentences, lists)


def spoken(name: str) -> str:
    """Return the words of a name: KitchenTable_01 is "kitchen table 01".

    >>> spoken("KitchenTable_01"), spoken("coke1"), spoken("TVCabinet")
    ('kitchen table 01', 'coke 1', 'tv cabinet')
    """
    split = re.sub(
        r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|(?<=[^\W\d])(?=\d)|(?<=\d)(?=[^\W\d])",
        " ",
        name,
    )
    return " ".join(re.sub(r"[\W_]+", " ", split).lower().split())


def _jsgf(sentences: Sequence[str], lists: Mapping[str, Sequence[str]]) -> str:
    choices = {
        name: f"[{words[1]}]" if words[0] == "" else f"({' | '.join(words)})"
        for name, words in CHOICES.items()
    }
    body = " | ".join(sentence.format_map(choices) for sentence in sentences)
    rules = [f"<{rule}> = {' | '.join(words)};" for rule, words in lists.items()]
    return "\n".join(["#JSGF V1.0;", "grammar semmap;", f"public <command> = {body};", *rules])


def _gbnf(sentences: Sequence[str], lists: Mapping[str, Sequence[str]]) -> str:
    rules = ["root ::= command"]
    rules.append("command ::= " + " | ".join(map(_gbnf_sentence, sentences)))
    for choice in ("relation", "a"):
        if any(f"{{{choice}}}" in sentence for sentence in sentences):
            rules.append(f"{choice} ::= {' | '.join(map(_quoted, CHOICES[choice]))}")
    rules += [
        f"{rule} ::= {' | '.join(_quoted(word) for word in words)}" for rule, words in lists.items()
    ]
    return "\n".join(rules)


def _gbnf_sentence(sentence: str) -> str:
    """Words as terminals, with the spaces that belong to them."""
    parts = []
    for part in re.findall(r"<\w+>|\{the\} ?|\{\w+\}|[^<{]+", sentence):
        if part.startswith("{the}"):
            parts.append('("the ")?')
        elif part[0] in "<{":
            parts.append(part[1:-1])
        else:
            parts.append(_quoted(part))
    return " ".join(parts)


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
