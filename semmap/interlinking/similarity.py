"""Similarities of values, in [0, 1]; 1 is equal. RapidFuzz compares texts."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.interlinking.correspondences import Correspondence, numbers
from semmap.interlinking.records import InterlinkingError, PropertyColumn, Records

Floats = NDArray[np.float64]
Texts = NDArray[np.object_]


def _rapidfuzz(module: str) -> Any:
    try:
        return importlib.import_module(f"rapidfuzz.{module}")
    except ImportError as error:
        raise InterlinkingError(
            "rapidfuzz is not installed; install the extra: pip install 'semmap[manipulation]'"
        ) from error


def _rate(left: Texts, right: Texts, scorer: Any) -> Floats:
    process = _rapidfuzz("process")
    rated: Floats = process.cpdist(left, right, scorer=scorer, dtype=np.float64, workers=2)
    return rated


def _letters(left: Texts, right: Texts) -> Floats:
    """One minus the share of letters to insert, delete, replace or exchange."""
    scorer = _rapidfuzz("distance.DamerauLevenshtein").normalized_similarity
    return _rate(left, right, scorer)


def _words(left: Texts, right: Texts) -> Floats:
    """As letters, with the words of both in alphabetical order."""
    scorer = _rapidfuzz("fuzz").token_sort_ratio
    return _rate(left, right, scorer) / 100


def _number(left: Texts, right: Texts) -> Floats:
    """One minus the relative difference; 0 where a text is not a number."""
    a, b = numbers(left), numbers(right)
    scale = np.maximum(np.abs(a), np.abs(b))
    with np.errstate(invalid="ignore"):
        found = 1 - np.abs(a - b) / np.where(scale > 0, scale, 1)
    return np.clip(np.where(np.isfinite(found), found, 0), 0, 1)


MEASURES: MappingProxyType[str, Callable[[Texts, Texts], Floats]] = MappingProxyType(
    {"letters": _letters, "words": _words, "number": _number}
)
"""How values are compared, by name."""


def compare(
    left: Records,
    right: Records,
    correspondences: Sequence[Correspondence],
    pairs: NDArray[np.int64],
) -> Floats:
    """Return the similarity of pairs, (n, 2), by correspondence; NaN where a value is missing."""
    found = np.empty((len(pairs), len(correspondences)))
    for i, one in enumerate(correspondences):
        columns = left.columns[one.left], right.columns[one.right]
        found[:, i] = _best(*columns, pairs, MEASURES[one.measure])
    return found


def _best(
    left: PropertyColumn,
    right: PropertyColumn,
    pairs: NDArray[np.int64],
    measure: Callable[[Texts, Texts], Floats],
) -> Floats:
    """The similarity of the most similar values of each pair."""
    counts = np.diff(left.starts)[pairs[:, 0]], np.diff(right.starts)[pairs[:, 1]]
    products = counts[0] * counts[1]
    found = np.full(len(pairs), np.nan)
    owner = np.repeat(np.arange(len(pairs)), products)
    if not len(owner):
        return found
    within = np.arange(len(owner)) - np.repeat(np.cumsum(products) - products, products)
    a = left.starts[pairs[owner, 0]] + within // counts[1][owner]
    b = right.starts[pairs[owner, 1]] + within % counts[1][owner]
    values = measure(left.texts[a], right.texts[b])
    np.fmax.at(found, owner, values) if products.max() > 1 else found.__setitem__(owner, values)
    return found
