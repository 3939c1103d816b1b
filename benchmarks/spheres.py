"""The workload of the region map: balls at centres that a linear congruential generator draws."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["centers"]

LOWEST = 100


def _numbers(state: int) -> Iterator[int]:
    # The constants of ANSI C's rand() as glibc has it; the low 8 bits are the least random.
    while True:
        state = (state * 1_103_515_245 + 12_345) % 2**31
        yield state // 256


def centers(count: int, span: int, seed: int = 42) -> list[tuple[int, int, int]]:
    """Centres with each coordinate in 100 ... 99 + span, in voxels.

    Examples
    --------
    >>> centers(1, 200)
    [(250, 255, 193)]
    """
    numbers = (LOWEST + number % span for number in _numbers(seed))
    return [(x, y, z) for x, y, z in islice(zip(numbers, numbers, numbers, strict=True), count)]
