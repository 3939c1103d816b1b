"""A data set: records with a key, and for each property any number of values."""

from __future__ import annotations

import hashlib
import json
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import regex
from numpy.typing import NDArray

from semmap.error import Error

Values = tuple[str, ...]

NOT_WORDS = regex.compile(r"[^\p{L}\p{N}.]+|\.(?!\d)|(?<!\d)\.")
"""Separators of words: a point is part of a number only."""


JOINED = regex.compile(r"(?<=\p{Ll})(?=\p{Lu})|(?<=\p{Lu})(?=\p{Lu}\p{Ll})")
"""Where a word of CamelCase begins: ChairA is chair a."""

ZEROS = regex.compile(r"(?<![\p{N}.])0+(?=\p{N})")  # zeros before a number: 01 is 1


def plain_text(value: str) -> str:
    """Return a value in lower case, without accents and punctuation, words one space apart.

    >>> plain_text("Café_ChairA-001")
    'cafe chair a 1'
    """
    if not value.isascii():
        parts = unicodedata.normalize("NFKD", value)
        value = "".join(c for c in parts if not unicodedata.combining(c))
    words = NOT_WORDS.sub(" ", JOINED.sub(" ", value).casefold())
    return ZEROS.sub("", words).strip()


class InterlinkingError(Error, ValueError):
    """A data set or labels that cannot be used: what is wrong, where, and how to fix it."""


@dataclass(frozen=True)
class PropertyColumn:
    """The values of a property in all n records, as plain text."""

    texts: NDArray[np.object_]  # record after record
    starts: NDArray[np.int64]  # (n + 1) where each record's texts begin

    @cached_property
    def owners(self) -> NDArray[np.int64]:
        """The record of each value."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))


@dataclass(frozen=True)
class Records:
    """A data set: n records."""

    name: str  # such as the file's
    keys: Sequence[str]  # a URI or the key of a row; each occurs once
    properties: Mapping[str, Sequence[Values]]  # n tuples of values for each; () without one

    def __post_init__(self) -> None:
        if not self.keys:
            raise InterlinkingError(f"{self.name}: has no records: give a file with at least one")
        if len(set(self.keys)) < len(self.keys):
            seen: set[str] = set()
            twice = next(k for k in self.keys if k in seen or seen.add(k))  # type: ignore[func-returns-value]
            raise InterlinkingError(
                f"{self.name}: the key {twice!r} occurs twice: give each record a key of its own"
            )
        for name, values in self.properties.items():
            if len(values) != len(self.keys):
                raise InterlinkingError(
                    f"{self.name}: {name} has {len(values)} values for {len(self.keys)} records"
                )

    def __len__(self) -> int:
        """How many records there are."""
        return len(self.keys)

    @cached_property
    def number(self) -> dict[str, int]:
        """The position of each key."""
        return {key: i for i, key in enumerate(self.keys)}

    @cached_property
    def columns(self) -> dict[str, PropertyColumn]:
        """The values of each property that has any, as plain text."""
        found = {}
        for name, values in self.properties.items():
            plain = [[text for v in of if (text := plain_text(v))] for of in values]
            starts = np.concatenate([[0], np.cumsum([len(of) for of in plain])]).astype(np.int64)
            if starts[-1]:
                texts = np.array([text for of in plain for text in of], dtype=object)
                found[name] = PropertyColumn(texts, starts)
        if not found:
            raise InterlinkingError(f"{self.name}: no record has a value: nothing to compare")
        return found

    def record(self, number: int) -> dict[str, Values]:
        """Return the values of one record, of the properties that it has."""
        return {name: of[number] for name, of in self.properties.items() if of[number]}

    @cached_property
    def digest(self) -> str:
        """A hash of the content, which is the same for the same keys and values."""
        hashed = hashlib.sha256()
        for i, key in enumerate(self.keys):
            hashed.update(json.dumps([key, self.record(i)], sort_keys=True).encode())
        return hashed.hexdigest()
