"""Files in the format ``.pomdp``, read as other solvers read them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from planner.search.pomdp import Pomdp
from tests.oracles.point_based import checked

_LISTS = ("states", "actions", "observations")
_HEADS = (*_LISTS, "discount", "values", "start", "T", "O", "R")


def read_pomdp(file: Path) -> Pomdp:
    """The POMDP in a ``.pomdp`` file whose entries are single values, ``identity`` or ``uniform``.

    Names or numbers of states, actions and observations are read, and ``*``. Rewards may depend on
    the action and the state.

    Raises
    ------
    ValueError
        The file cannot be read; the message names the line.
    """
    values: dict[str, list[str]] = {}
    entries: list[tuple[int, str, list[str]]] = []
    for number, head, words in _statements(file):
        if head in ("T", "O", "R"):
            entries.append((number, head, words))
        else:
            values[head] = words
    missing = [key for key in ("discount", *_LISTS) if key not in values]
    if missing:
        raise ValueError(f"{file}: it has no line {missing[0]}: add one")
    names = {kind: _names(values[kind], kind[0]) for kind in _LISTS}
    n, m, k = (len(names[kind]) for kind in _LISTS)
    transitions, likelihoods, rewards = np.zeros((m, n, n)), np.zeros((m, n, k)), np.zeros((m, n))
    for number, head, words in entries:
        where = f"{file}, line {number}"
        *parts, last = [part.split() for part in " ".join(words).split(":")]
        fields = [*(part[0] for part in parts if part), *last]
        a = _index(fields[0], names["actions"], where)
        array, columns = (
            (transitions, names["states"]) if head == "T" else (likelihoods, names["observations"])
        )
        if fields[-1] in ("identity", "uniform") and len(fields) == 2 and head != "R":
            array[a] = np.eye(n) if fields[-1] == "identity" else 1 / array.shape[2]
            continue
        expected = 5 if head == "R" else 4
        if len(fields) != expected:
            raise ValueError(f"{where}: {head} has {len(fields)} fields; write {expected}")
        s = _index(fields[1], names["states"], where)
        value = _number(fields[-1], where)
        if head != "R":
            array[a, s, _index(fields[2], columns, where)] = value
        elif fields[2:4] != ["*", "*"]:
            raise ValueError(f"{where}: a reward depends on what follows; write * : *")
        else:
            rewards[a, s] = value
    if values.get("values", ["reward"])[0] == "cost":
        rewards = -rewards
    start = values.get("start", ["uniform"])
    belief = (
        np.full(n, 1 / n)
        if start == ["uniform"]
        else np.array([_number(word, f"{file}, start") for word in start])
    )
    read = Pomdp(
        tuple(names["states"]),
        tuple(names["actions"]),
        tuple(names["observations"]),
        transitions,
        likelihoods,
        rewards,
        belief,
        _number(values["discount"][0], f"{file}, discount"),
    )
    return checked(read)


def _statements(file: Path) -> Iterator[tuple[int, str, list[str]]]:
    """Line, keyword and the words after it; a statement may go on in the next lines."""
    current: tuple[int, str, list[str]] | None = None
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
        text = line.split("#")[0].strip()
        if not text:
            continue
        head, colon, rest = text.partition(":")
        if colon and head.strip() in _HEADS:
            if current is not None:
                yield current
            current = number, head.strip(), rest.replace(":", " : ").split()
        elif current is None:
            raise ValueError(f"{file}, line {number}: {text[:20]!r} has no keyword before it")
        else:
            current[2].extend(text.replace(":", " : ").split())
    if current is not None:
        yield current


def _names(words: list[str], letter: str) -> list[str]:
    """The names that are listed, or of a number of them."""
    if len(words) == 1 and words[0].isdigit():
        return [f"{letter}{k}" for k in range(int(words[0]))]
    return words


def _index(word: str, names: Sequence[str], where: str) -> int | slice:
    if word == "*":
        return slice(None)
    if word in names:
        return names.index(word)
    if word.isdigit() and int(word) < len(names):
        return int(word)
    raise ValueError(f"{where}: {word} is not among {', '.join(names[:8])}")


def _number(word: str, where: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise ValueError(f"{where}: {word!r} is not a number") from None
