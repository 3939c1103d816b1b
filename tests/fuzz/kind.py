"""What is fuzzed: seeds, how they are mutated, and what takes the result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from random import Random

from semmap.error import Error
from tests.fuzz.mutate import MOST_BYTES, Mutation

SERVER = "SEMMAP_FUZZ_DB"
"""Environment variable with the URL of a database that has the map of `stored_knowledge`."""


@dataclass(frozen=True)
class Kind:
    """A kind of input.

    Attributes
    ----------
    name : of the kind, also of the folder with its cases
    make_seeds : valid inputs, as bytes
    mutations : one of them is chosen for each case
    run : takes an input, and a folder for files; returns where it is accepted
    refused : what it may raise; a native function raises errors of Python
    server : whether it needs the database of `SERVER`
    """

    name: str
    make_seeds: Callable[[], Sequence[bytes]]
    mutations: Sequence[Mutation]
    run: Callable[[bytes, Path], None]
    refused: tuple[type[BaseException], ...] = (Error,)
    server: bool = True

    @cached_property
    def seeds(self) -> list[bytes]:
        """Valid inputs, the smaller ones first and those that are too large left out."""
        return sorted({s for s in self.make_seeds() if len(s) <= MOST_BYTES}, key=len)

    def case(self, number: int, seed: str) -> bytes:
        """The input of a number, the same whenever it is made."""
        random = Random(f"{seed} {self.name} {number}")
        # Small seeds are quick, and what is wrong with them is easy to see.
        first = self.seeds[
            min(random.randrange(len(self.seeds)), random.randrange(len(self.seeds)))
        ]
        mutation = random.choice(self.mutations)
        try:
            return mutation(random, first, random.sample(self.seeds, min(4, len(self.seeds))))
        except RecursionError:  # a tree that is too deep to be written
            return first
