"""Statistics of properties, by which those of two data sets are compared (Fan, K-medoids)."""

from __future__ import annotations

from collections.abc import Sequence
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from semmap.interlinking.records import PropertyColumn, Records

SAMPLE = 5_000
"""At most so many values of a property are looked at: a change of the order of records may then
change statistics in the third digit."""


def property_statistics(records: Records) -> NDArray[np.float64]:
    """Return the statistics of each property, shape (properties, 10)."""
    return np.array([_statistics(column, len(records)) for column in records.columns.values()])


def _statistics(column: PropertyColumn, records: int) -> list[float]:
    sample = _sample(column)
    lengths = np.array([len(t) for t in sample], dtype=float)
    total = lengths.sum()
    together = "".join(sample)
    values = numbers(sample)
    finite = values[np.isfinite(values)]
    return [
        np.count_nonzero(np.diff(column.starts)) / records,
        len(set(sample)) / len(sample),
        np.log2(lengths.mean()),
        np.log2(1 + lengths.std()),
        np.log2(np.mean([t.count(" ") + 1 for t in sample])),
        sum(map(str.isdigit, together)) / total,
        sum(map(str.isalpha, together)) / total,
        len(finite) / len(sample),
        np.count_nonzero(finite == np.round(finite)) / len(sample),
        float(np.log10(1e-6 + np.median(np.abs(finite)))) if len(finite) else 0.0,
    ]


def _sample(column: PropertyColumn) -> list[str]:
    step = max(len(column.texts) // SAMPLE, 1)
    return column.texts[::step].tolist()  # type: ignore[no-any-return]


def numbers(texts: Sequence[str] | NDArray[np.object_]) -> NDArray[np.float64]:
    """Return texts as numbers; NaN where one is not a finite number."""
    found = np.full(len(texts), np.nan)
    for i, text in enumerate(texts):
        try:
            found[i] = float(text)
        except ValueError:
            continue
    found[np.isinf(found)] = np.nan
    return found


def is_numeric(column: PropertyColumn) -> bool:
    """Return whether the values are measurements: numbers of which some have a fraction."""
    values = numbers(_sample(column))
    share = np.isfinite(values).mean()
    return bool(share > 0.9 and np.any(values[np.isfinite(values)] % 1))


def common_words(columns: Sequence[PropertyColumn]) -> NDArray[np.float64]:
    """Return the overlap coefficient of the words of properties, (n, n): by the smaller set."""
    words = [set(" ".join(_words_of(column)).split()) for column in columns]
    return np.array([[len(a & b) / min(len(a), len(b)) for b in words] for a in words])


def _words_of(column: PropertyColumn) -> list[str]:
    """Texts of a column; of many, those whose hash is smallest, which another column has, too."""
    texts = set(column.texts.tolist())
    if len(texts) <= SAMPLE:
        return list(texts)
    return sorted(texts, key=lambda text: crc32(text.encode()))[:SAMPLE]
