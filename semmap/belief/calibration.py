"""Whether probabilities are as often right as they say: a curve, its error, and proper scores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Calibration:
    """Forecasts in groups, the least probable first; each group is about as unsure as the others.

    Attributes
    ----------
    predicted, observed : (groups,) the mean probability, and how often it came true
    count : (groups,) forecasts
    error : the expected calibration error: the mean of |predicted - observed| over forecasts
    log_score, brier_score : of the single forecasts, less is better
    """

    predicted: Floats
    observed: Floats
    count: NDArray[np.intp]
    error: float
    log_score: float
    brier_score: float

    def as_json(self) -> dict[str, Any]:
        """The curve and its scores as plain values."""
        names = ("error", "log_score", "brier_score")
        curve = zip(*(v.tolist() for v in (self.predicted, self.observed, self.count)), strict=True)
        rows = [dict(zip(("predicted", "observed", "count"), row, strict=True)) for row in curve]
        return {name: getattr(self, name) for name in names} | {"curve": rows}


def calibrate(probability: ArrayLike, came_true: ArrayLike, groups: int = 10) -> Calibration:
    """Judge forecasts by what happened: (n,) probabilities, (n,) whether each came true; n > 0.

    Examples
    --------
    >>> calibrate([0.2] * 5 + [0.9] * 10, [1] + [0] * 4 + [1] * 9 + [0], groups=2).error
    0.0
    """
    chance, true = np.asarray(probability, np.float64), np.asarray(came_true, np.float64)
    order = np.argsort(chance, kind="stable")
    ranked = chance[order]
    unsure = np.cumsum(ranked * (1 - ranked) + 1e-9)  # how many events may be otherwise
    even = np.searchsorted(unsure, unsure[-1] * np.arange(groups) / groups)
    first = np.unique(np.searchsorted(ranked, ranked[even]))  # equal ones stay together
    count = np.diff(np.append(first, len(chance)))
    predicted = np.add.reduceat(ranked, first) / count
    observed = np.add.reduceat(true[order], first) / count
    sure = np.clip(chance, 1e-12, 1 - 1e-12)
    return Calibration(
        predicted,
        observed,
        count,
        float((np.abs(predicted - observed) * count).sum() / len(chance)),
        float(-np.where(true > 0, np.log(sure), np.log1p(-sure)).mean()),
        float(((chance - true) ** 2).mean()),
    )


def draw_calibrations(curves: Mapping[str, Calibration], path: Path | str) -> Path:
    """Draw curves by their names, and save the picture; return its path.

    Below the diagonal, things come true less often than the forecasts say. A point is as large as
    its group.
    """
    from semmap.draw.sheet import paper_sheet, save_sheet

    figure = paper_sheet(4.5, 4.5, 200)
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="#999999", lw=0.8)
    for name, one in curves.items():
        label = f"{name}: error {one.error:.3f}"
        (line,) = axes.plot(one.predicted, one.observed, lw=1, label=label)
        sizes = 8 + 80 * np.sqrt(one.count / one.count.max())
        axes.scatter(one.predicted, one.observed, sizes, color=line.get_color(), alpha=0.7)
    axes.set(xlabel="predicted", ylabel="observed", xlim=(0, 1), ylim=(0, 1), aspect="equal")
    axes.legend(loc="upper left", frameon=False)
    return save_sheet(figure, path)
