"""NumPy files from elsewhere: their header is checked before their values are read."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from semmap.limits import ARRAY_VALUES, Limit

HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""What reads the header of a version; a later one has names of fields, which no array here has."""


def read_npy(
    file: Path | BinaryIO, limit: Limit = ARRAY_VALUES, values_each: int = 1
) -> NDArray[Any]:
    """Return the real numbers of a NumPy file; the limit counts so many values as one.

    ValueError: it is damaged, of another kind, such as complex, or has more values than the limit.
    """
    if isinstance(file, Path):
        with file.open("rb") as stream:
            return read_npy(stream, limit, values_each)
    start = file.tell()
    version = npy.read_magic(file)
    if version not in HEADERS:
        raise ValueError(f"it is of version {version}: save it by numpy.save")
    shape, _, kind = HEADERS[version](file)
    if kind.kind not in "biuf":
        raise ValueError(f"it has values of the type {kind}: give real numbers")
    limit.check(
        math.prod(shape) / values_each,
        lambda problem, fix: ValueError(f"{problem}. {fix}"),
        "Give fewer.",
    )
    file.seek(start)
    return np.asarray(np.load(file, allow_pickle=False))
