"""Goals in the paper's terms: ``on(muffin, desk1)`` (Deeken et al., Figure 4)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from semmap.error import Error
from semmap.suggestions import suggestion

ROBOT = "robot"  # the word for the planning robot

RELATIONS = {"on": 2, "in": 2, "carries": 2}
"""Relations of the planner with their numbers of arguments; domain files add more."""

_TOKEN = re.compile(
    r"""\s*(?:(?P<and>,|;|&|∧|and\b)|(?P<open>\()|(?P<close>\))
    |(?P<quoted>"[^"]*"|'[^']*')|(?P<word>[^\s(),;&∧"']+))""",
    re.VERBOSE,
)
_ARTICLES = ("a", "an", "the", "some", "any")


class GoalError(Error, ValueError):
    """A goal that cannot be read, or that contradicts itself."""


@dataclass(frozen=True, order=True)
class Word:
    """A word of a goal for an object or a place: its name, type or label.

    The same word stands for the same object throughout a goal. "another muffin" is a second one,
    "another another muffin" (`number` 2) a third.
    """

    text: str
    number: int = 0

    def __str__(self) -> str:
        return "another " * self.number + self.text


@dataclass(frozen=True)
class Atom:
    """One condition of a goal: ``on(muffin, desk1)``."""

    relation: str
    words: tuple[Word, ...]

    def __str__(self) -> str:
        return f"{self.relation}({', '.join(map(str, self.words))})"


@dataclass(frozen=True)
class Goal:
    """A conjunction of conditions."""

    text: str
    atoms: tuple[Atom, ...]

    def words(self) -> list[Word]:
        """The words for objects and places, each once, in order."""
        words = (word for atom in self.atoms for word in atom.words)
        return list(dict.fromkeys(w for w in words if w.text != ROBOT))


def parse_goal(text: str, relations: Iterable[tuple[str, int]] = ()) -> Goal:
    """The goal that a text describes: ``on(a muffin, desk1) and in(robot, kitchen)``.

    `relations` are those of a domain file, with their numbers of arguments.

    Raises
    ------
    GoalError
        The text is not a conjunction of ``relation(word, word)``, or contradicts itself.
    """
    known = {**RELATIONS, **dict(relations)}
    atoms = tuple(dict.fromkeys(_Reader(text, known).atoms()))
    _refuse_contradictions(atoms)
    return Goal(text.strip(), atoms)


class _Reader:
    """Reads the tokens of a goal."""

    def __init__(self, text: str, known: dict[str, int]) -> None:
        self.text, self.known = text, known
        self.tokens: list[tuple[str, str, int]] = []
        at = 0
        end = len(text.rstrip())
        while at < end:
            found = _TOKEN.match(text, at)
            if found is None:
                raise GoalError(
                    f"{text!r}: unexpected {text[at:].strip()[:12]!r}; close the quotes"
                )
            kind = str(found.lastgroup)
            self.tokens.append((kind, found[kind], found.start(kind)))
            at = found.end()
        self.next = 0

    def atoms(self) -> list[Atom]:
        if not self.tokens:
            raise GoalError("the goal is empty; write for example on(muffin, desk1)")
        found = [self._atom()]
        while self.next < len(self.tokens):
            while self._peek() == "and":  # "and", a comma, or both
                self.next += 1
            found.append(self._atom())
        return found

    def _peek(self) -> str | None:
        return self.tokens[self.next][0] if self.next < len(self.tokens) else None

    def _take(self, kind: str, what: str) -> str:
        if self._peek() != kind:
            here = repr(self.tokens[self.next][1]) if self._peek() else "the end"
            at = self.tokens[self.next][2] if self._peek() else len(self.text)
            raise GoalError(
                f"{self.text!r}: {what} is expected at character {at + 1}, where {here} is; "
                "a goal reads on(muffin, desk1) and in(robot, kitchen)"
            )
        self.next += 1
        return self.tokens[self.next - 1][1]

    def _atom(self) -> Atom:
        name = self._take("word", "a relation")
        self._take("open", f"( after {name}")
        words = [self._word()]
        while self._peek() == "and":
            self._take("and", ",")
            words.append(self._word())
        self._take("close", ")")
        return self._checked(name, words)

    def _word(self) -> Word:
        parts: list[str] = []
        quoted = False
        while self._peek() in ("word", "quoted"):
            kind, text, _ = self.tokens[self.next]
            quoted = quoted or kind == "quoted"
            parts.append(text[1:-1] if kind == "quoted" else text)
            self.next += 1
        if not parts:
            self._take("word", "a name or a type")
        number = 0
        while not quoted and len(parts) > 1 and parts[0] in (*_ARTICLES, "another"):
            number += parts[0] == "another"
            del parts[0]
        return Word(" ".join(parts), number)

    def _checked(self, name: str, words: Sequence[Word]) -> Atom:
        if name not in self.known:
            hint = suggestion(name, self.known, f"there are {', '.join(self.known)}")
            raise GoalError(f"there is no relation {name}{hint}")
        if len(words) != self.known[name]:
            raise GoalError(
                f"{Atom(name, tuple(words))} has {len(words)} arguments; {name} takes "
                f"{self.known[name]}"
            )
        robots = [i for i, word in enumerate(words) if word.text == ROBOT]
        atom = Atom(name, tuple(words))
        if name == "on" and robots:
            raise GoalError(f"{atom}: no object can be on or under a robot; use in(robot, ...)")
        if name == "in" and 1 in robots:
            raise GoalError(f"{atom}: no object can be in the robot; use carries(robot, ...)")
        if name == "carries" and robots != [0]:
            raise GoalError(f"{atom}: only the robot carries; use carries(robot, ...)")
        return atom


def _refuse_contradictions(atoms: Sequence[Atom]) -> None:
    below: dict[Word, Atom] = {}
    for atom in atoms:
        if len(set(atom.words)) < len(atom.words):
            raise GoalError(f"{atom}: {atom.words[0]} cannot be {atom.relation} itself")
        if atom.relation == "carries":
            for other in atoms:
                if other.relation in ("on", "in") and other.words[0] == atom.words[1]:
                    raise GoalError(
                        f"{atom} and {other} contradict each other: what the robot carries is in "
                        "no other place; drop one of them"
                    )
        item = atom.words[0]
        same = below.get(item) if atom.relation == "on" else None
        if atom.relation == "in" and item.text == ROBOT:
            places = (a for a in atoms if a.relation == "in" and a.words[0] == item)
            same = next((other for other in places if other != atom), None)
        if same is not None:
            hint = "" if item.text == ROBOT else f" (a second one is: another {item})"
            raise GoalError(
                f"{same} and {atom} contradict each other: {item} is in one place only; drop one "
                f"of them{hint}"
            )
        if atom.relation == "on":
            below[item] = atom
    for start in below:
        chain = [start]
        while chain[-1] in below:
            chain.append(below[chain[-1]].words[1])
            if chain[-1] == start:
                raise GoalError(
                    f"{' and '.join(str(below[w]) for w in chain[:-1])} contradict each other: "
                    "objects cannot stand on each other in a circle; drop one of them"
                )
            if len(chain) > len(below) + 1:
                break
