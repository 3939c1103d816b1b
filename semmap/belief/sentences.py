"""What a sentence of the grammar says: its form and its names; of another one, the nearest.

Words are compared as `spoken` writes them: capitals, punctuation and underscores do not matter.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import lru_cache

from semmap.belief.error import BeliefError
from semmap.belief.grammar import CHOICES, LISTS, SENTENCES, STATEMENTS, TYPE_IS_A, spoken
from semmap.belief.teaching import KnownRelation

Names = Mapping[str, Mapping[str, list[str]]]
"""By the rule of the grammar: the names that the map writes, by what is spoken."""


@dataclass(frozen=True)
class Sentence:
    """A sentence that was understood.

    Attributes
    ----------
    form : one of `semmap.belief.grammar.SENTENCES`
    names : as the map writes them, in the order of the sentence
    relation : ``in`` or ``on`` of a sentence that says where an object is
    """

    form: str
    names: tuple[str, ...]
    relation: str | None = None

    @property
    def stated(self) -> KnownRelation:
        """The relation that it teaches; `BeliefError` if it is a question or a command."""
        if self.form not in STATEMENTS:
            raise BeliefError(
                f'"{self}" states nothing: `semmap ask` answers it; a sentence that teaches is '
                + " or ".join(f'"{_plain(form)}"' for form in STATEMENTS)
            )
        subject, other = self.names
        relation = self.relation or "isA"
        return KnownRelation(subject, relation, other, of_classes=self.form == TYPE_IS_A)

    def __str__(self) -> str:
        """The sentence, with the names as the map writes them."""
        names = iter(self.names)
        plain = _plain(self.form, self.relation or "in")
        return _with_articles(re.sub(r"<\w+>", lambda _: next(names), plain))


def understand(text: str, names: Mapping[str, Sequence[str]]) -> Sentence:
    """Return what a sentence of the grammar of a map says.

    `names` are those of `semmap.belief.grammar.write_grammar`.

    Raises
    ------
    BeliefError
        It is not a sentence of the grammar (the error has the nearest one), or two names are spoken
        like this.

    Examples
    --------
    >>> names = {"things": ["coke1"], "places": ["KitchenTable"]}
    >>> understand("The coke 1 is on the kitchen table.", names).names
    ('coke1', 'KitchenTable')
    >>> understand("where is the cola", names)
    Traceback (most recent call last):
    ...
    semmap.belief.error.BeliefError: "where is the cola" is not a sentence that the map \
understands; the nearest is "where is the coke 1"; `semmap belief grammar` writes all
    """
    words, known = spoken(text).split(), _spoken_names(names)
    found = [
        Sentence(form, tuple(said), relation)
        for form in SENTENCES
        for said, relation in _readings(form.split(), words, known)
    ]
    found = [*dict.fromkeys(found)]
    if not found:
        near = nearest_sentence(text, names)
        raise BeliefError(
            f'"{text}" is not a sentence that the map understands; the nearest is "{near}"; '
            "`semmap belief grammar` writes all"
        )
    if len(found) > 1:
        raise BeliefError(
            f'"{text}" is ambiguous: it may be '
            + " or ".join(f'"{each}"' for each in found)
            + ": rename one of them"
        )
    return found[0]


def nearest_sentence(text: str, names: Mapping[str, Sequence[str]]) -> str:
    """Return the sentence of the grammar with the least edit distance to a text, word by word.

    A missing or additional word costs its letters, a replaced one the letters that are not in both.
    `BeliefError` if there are no names, so that there is no sentence.
    """
    words, known = spoken(text).split(), _spoken_names(names)
    ends = []
    for form in SENTENCES:
        row = [(float(sum(map(len, words[:count]))), "") for count in range(len(words) + 1)]
        for part in form.split():
            rows = [_extended(row, each.split(), words) for each in _alternatives(part, known)]
            row = [min(column) for column in zip(*rows, strict=True)]
            if not row:
                break
        ends += row[-1:]
    if not ends:
        raise BeliefError("the map has no names: import a world, or teach objects")
    return _with_articles(min(ends)[1])


def _with_articles(sentence: str) -> str:
    """A sentence with *an* before a vowel: an object is a thing."""
    return re.sub(
        r"(^|\bis )an? (?=(\w))",
        lambda found: f"{found[1]}{'an' if found[2].lower() in 'aeiou' else 'a'} ",
        sentence,
    )


Row = list[tuple[float, str]]
"""The least cost of the first words of a text, and the beginning of a sentence that has it."""


def _extended(row: Row, more: Sequence[str], words: Sequence[str]) -> Row:
    """The row after more words of the sentence: the edit distance, one row a word."""
    for word in more:
        written = [f"{text} {word}".strip() for _, text in row]
        new = [(row[0][0] + len(word), written[0])]
        for i, given in enumerate(words):
            new.append(
                min(
                    (row[i][0] + _difference(given, word), written[i]),
                    (row[i + 1][0] + len(word), written[i + 1]),
                    (new[i][0] + len(given), new[i][1]),
                )
            )
        row = new
    return row


@lru_cache(2**16)
def _difference(word: str, other: str) -> float:
    """How many letters of two words are not in both."""
    return len(word + other) * (1 - SequenceMatcher(None, word, other, autojunk=False).ratio())


def _alternatives(part: str, known: Names) -> Sequence[str]:
    """What may stand for a part of a form."""
    if part[0] == "<":
        return sorted(known[part[1:-1]])
    return CHOICES[part[1:-1]] if part[0] == "{" else (part,)


def _readings(
    parts: Sequence[str], words: Sequence[str], known: Names
) -> Iterator[tuple[list[str], str | None]]:
    """All ways to read words as the parts of a form: its names, and its relation."""
    if not parts:
        if not words:
            yield [], None
        return
    first, rest = parts[0], parts[1:]
    if first[0] == "<":
        for end in range(1, len(words) + 1):
            for name in known[first[1:-1]].get(" ".join(words[:end]), ()):
                for names, relation in _readings(rest, words[end:], known):
                    yield [name, *names], relation
        return
    for word in _alternatives(first, known):
        count = len(word.split())
        if [*words[:count]] == word.split():
            for names, relation in _readings(rest, words[count:], known):
                yield names, word if first == "{relation}" else relation


def _spoken_names(names: Mapping[str, Sequence[str]]) -> Names:
    found: dict[str, dict[str, list[str]]] = {rule: {} for rule in LISTS}
    for rule, part in LISTS.items():
        for name in names.get(part, ()):
            if text := spoken(name):
                found[rule].setdefault(text, []).append(name)
    return found


def _plain(form: str, relation: str = "in") -> str:
    """A form with a word for each choice: the <thing> is in the <place>."""
    return form.format(the="the", a="a", relation=relation)
