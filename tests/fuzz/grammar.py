"""Sentences of SPARQL, right or nearly so: what its dialects have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from random import Random
from typing import ClassVar


class Grammar(ABC):
    """Makes group graph patterns at random; a dialect adds its words, expressions and queries."""

    NOUNS: ClassVar[tuple[str, ...]]
    """Subjects and objects."""

    DATA: ClassVar[tuple[str, ...]]
    """Terms of VALUES."""

    VERBS: ClassVar[tuple[str, ...]]

    def __init__(self, random: Random) -> None:
        self.random = random
        self.left = random.choice((5, 20, 60, 200))

    @abstractmethod
    def query(self) -> str:
        """A query."""

    @abstractmethod
    def expression(self) -> str:
        """What a filter takes."""

    def own_part(self) -> str:
        """A part of a group that only the dialect has."""
        return self.pattern()

    def group(self) -> str:
        parts = [self.part() for _ in range(self.random.choice((0, 1, 1, 2, 4)))]
        return "{ " + " ".join(parts) + " }"

    def part(self) -> str:
        self.left -= 1
        pick = self.random.choice
        if self.left < 0:
            return self.pattern()
        match self.random.randrange(12):
            case 0:
                return f"OPTIONAL {self.group()}"
            case 1:
                return f"{self.group()} UNION {self.group()}"
            case 2:
                return f"MINUS {self.group()}"
            case 3 | 4:
                return f"FILTER({self.expression()})"
            case 5:
                return f"BIND({self.expression()} AS ?n{self.random.randrange(5)})"
            case 6:
                return f"VALUES ?a {{ {' '.join(pick((*self.DATA, 'UNDEF')) for _ in range(3))} }}"
            case 7:
                return f"FILTER {pick(('', 'NOT '))}EXISTS {self.group()}"
            case 8:
                return "{ " + self.query() + " }"
            case 9:
                return self.own_part()
            case _:
                return self.pattern()

    def pattern(self) -> str:
        pick = self.random.choice
        return f"{pick(self.NOUNS)} {pick(self.VERBS)} {pick(self.NOUNS)} ."
