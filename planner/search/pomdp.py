"""A partially observable Markov decision process as arrays."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semmap.arrays import Floats
from semmap.whole_file import write_whole


@dataclass(frozen=True, eq=False)
class Pomdp:
    """States, actions and observations, by unique names, with their probabilities and rewards.

    `transitions` (A, S, S) is P(next state | action, state), `likelihoods` (A, S, O) P(observation
    | action, next state), `rewards` (A, S) what an action is worth in a state, `start` (S,) the
    first belief. With a discount of 1, some action must lead to a state that no action leaves or
    rewards.
    """

    states: tuple[str, ...]
    actions: tuple[str, ...]
    observations: tuple[str, ...]
    transitions: Floats
    likelihoods: Floats
    rewards: Floats
    start: Floats
    discount: float = 1.0


_LISTS = ("states", "actions", "observations")
_HEADS = (*_LISTS, "discount", "values", "start", "T", "O", "R")


def write_pomdp(pomdp: Pomdp, file: Path, comment: str = "") -> Path:
    """Write a POMDP as a ``.pomdp`` file; numbers are exact. A comment is its first line.

    Names have only letters, digits, ``-`` and ``_`` there; comments give the original ones.
    Many solvers want a discount below 1: 0.999 changes a search of a few minutes little.
    """
    lines = [f"# {comment}"] if comment else []
    lines += [f"discount: {pomdp.discount!r}", "values: reward"]
    identifiers = {}
    for kind in _LISTS:
        names = getattr(pomdp, kind)
        identifiers[kind] = _identifiers(names, kind[0])
        lines.append(f"{kind}: {' '.join(identifiers[kind])}")
        changed = zip(identifiers[kind], names, strict=True)
        lines += [
            f"# {short}: {' '.join(name.split())}" for short, name in changed if short != name
        ]
    states, actions, observations = (identifiers[kind] for kind in _LISTS)
    lines.append("start: " + " ".join(repr(float(p)) for p in pomdp.start))
    for a, action in enumerate(actions):
        if np.array_equal(pomdp.transitions[a], np.eye(len(states))):
            lines.append(f"T: {action} identity")
        else:
            lines += [
                f"T: {action} : {states[s]} : {states[t]} {float(pomdp.transitions[a, s, t])!r}"
                for s, t in np.argwhere(pomdp.transitions[a])
            ]
    for a, action in enumerate(actions):
        lines += [
            f"O: {action} : {states[s]} : {observations[o]} {float(pomdp.likelihoods[a, s, o])!r}"
            for s, o in np.argwhere(pomdp.likelihoods[a])
        ]
    for a, action in enumerate(actions):
        lines += [
            f"R: {action} : {states[s]} : * : * {float(pomdp.rewards[a, s])!r}"
            for s in np.flatnonzero(pomdp.rewards[a])
        ]
    write_whole(file, "\n".join(lines) + "\n")
    return file


def _identifiers(names: Sequence[str], letter: str) -> list[str]:
    """Unique names of the characters that the format allows."""
    found: list[str] = []
    taken: set[str] = set()
    for number, name in enumerate(names):
        short = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")
        if not short or not short[0].isalpha() or short in taken or short in _HEADS:
            short = f"{letter}{number}_{short}".rstrip("_")
        while short in taken:
            short += "_"
        taken.add(short)
        found.append(short)
    return found
