"""Candidate pairs: records that share rare words, so that not all pairs are compared."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from semmap.interlinking.correspondences import Correspondence
from semmap.interlinking.records import Records

PER_RECORD = 10  # the most candidates of a record
WORTH = 0.2  # a candidate has at least this share of the best candidate's words
WORK = 100
"""The most pairs that share a word, on average over the records: the words of the fewest pairs
are used first. The time is therefore linear in the number of records."""
ROWS = 5_000  # records at a time


def candidate_pairs(
    left: Records,
    right: Records,
    correspondences: Sequence[Correspondence],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return pairs of records that may be the same, and how much of their words they share.

    A word, and each half of a longer word, is a key: a single wrong letter leaves one half. Keys do
    not depend on the property, so that exchanged fields do no harm. A pair is kept if it is among
    the `PER_RECORD` best of its left or of its right record. Pairs are (n, 2), in ascending order;
    what they share is (n,): the cosine similarity of keys, weighted by rarity.
    """
    numbers: dict[str, int] = {}
    a = _keys(left, {c.left for c in correspondences}, numbers)
    b = _keys(right, {c.right for c in correspondences}, numbers)
    a.resize(len(left), len(numbers))
    b.resize(len(right), len(numbers))
    of_a, of_b = (np.asarray((m > 0).sum(axis=0)).ravel() for m in (a, b))
    rarity = np.log((len(left) + len(right)) / np.maximum(of_a + of_b, 1))
    a, b = (_unit(m @ sparse.diags(rarity)) for m in (a, b))
    work = of_a.astype(np.int64) * of_b
    order = np.argsort(work, kind="stable")
    used = order[np.cumsum(work[order]) <= WORK * (len(left) + len(right))]
    used = used[work[used] > 0]
    a, b = a[:, used].tocsr(), b[:, used].tocsr()
    total = len(left) + len(right)
    there = _best_of_rows(a, b, lambda done: progress(done, total))
    back = _best_of_rows(b, a, lambda done: progress(len(left) + done, total))
    first, second, shared = (
        np.concatenate(c) for c in zip(there, (back[1], back[0], back[2]), strict=True)
    )
    code, place = np.unique(first * len(right) + second, return_index=True)
    pairs = np.column_stack(np.divmod(code, len(right)))
    return pairs, np.clip(shared[place], 0.0, 1.0)


def _best_of_rows(
    a: sparse.csr_matrix, b: sparse.csr_matrix, progress: Callable[[int], None]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Rows of `a`, rows of `b` and their products: the `PER_RECORD` largest of each row of `a`."""
    turned = b.T.tocsr()
    found = []
    for start in range(0, a.shape[0], ROWS):
        part = a[start : start + ROWS] @ turned
        counts = np.diff(part.indptr)
        filled = np.flatnonzero(counts)
        top = np.zeros(len(counts))
        if len(filled):
            top[filled] = np.maximum.reduceat(part.data, part.indptr[filled])
        owner = np.repeat(np.arange(len(counts)), counts)
        near = np.flatnonzero(part.data >= WORTH * top[owner])
        owner, other, value = owner[near], part.indices[near], part.data[near]
        order = np.lexsort((other, -value, owner))
        sizes = np.bincount(owner, minlength=len(counts))
        rank = np.arange(len(order)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        best = order[rank < PER_RECORD]
        found.append(
            (owner[best].astype(np.int64) + start, other[best].astype(np.int64), value[best])
        )
        progress(min(start + ROWS, a.shape[0]))
    first, second, value = (np.concatenate(column) for column in zip(*found, strict=True))
    return first, second, value


def _keys(records: Records, properties: set[str], numbers: dict[str, int]) -> sparse.csr_matrix:
    """Which keys each record has, (records, keys); `numbers` has the column of each key."""
    rows: list[int] = []
    columns: list[int] = []
    for name in sorted(properties):
        column = records.columns[name]
        for owner, text in zip(column.owners.tolist(), column.texts.tolist(), strict=True):
            for key in _keys_of(text):
                rows.append(owner)
                columns.append(numbers.setdefault(key, len(numbers)))
    found = sparse.csr_matrix(
        (np.ones(len(rows)), (rows, columns)), shape=(len(records), len(numbers))
    )
    found.data[:] = 1
    return found


def _keys_of(text: str) -> list[str]:
    found = []
    for word in text.split():
        found.append(word)
        if len(word) >= 5:
            middle = len(word) // 2
            found += [word[:middle] + "*", "*" + word[-middle:]]
    return found


def _unit(matrix: sparse.csr_matrix) -> sparse.csr_matrix:
    norm = np.sqrt(np.asarray(matrix.multiply(matrix).sum(axis=1)).ravel())
    return sparse.diags(1 / np.where(norm > 0, norm, 1)) @ matrix
