"""Two ways to learn when things move, and where to: parts of the day, and waves (a spectrum).

Homes at random with weeks of use; beliefs at random times of days that nothing was learned from are
judged by the moves, which nobody told the map.
"""

from __future__ import annotations

import numpy as np

from benchmarks.bench_map import fresh_map
from benchmarks.timing import Row, print_rows
from semmap.belief.calibration import calibrate
from semmap.belief.learning import parts_of_day, waves_of_day
from tests.households import HELD_OUT, furnished_home, learned_by_hours

HOMES = 6
DAYS = 21, 63
HOURS = {
    "no hours": None,
    "4 parts": parts_of_day(4),
    "6 parts, as the map": parts_of_day(6),
    "8 parts": parts_of_day(8),
    "1 wave": waves_of_day(1),
    "2 waves": waves_of_day(2),
    "3 waves": waves_of_day(3),
}


def main() -> None:
    """Print the scores of both ways, beside beliefs that know no hours."""
    for days in DAYS:
        print_rows(f"{HOMES} homes, {days - HELD_OUT} days to learn from", scores(days))


def scores(days: int) -> list[Row]:
    """The mean log and Brier scores of each way, less is better."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in HOURS}
    for seed in range(HOMES):
        with fresh_map(f"home{seed}", lambda db, seed=seed: furnished_home(db, seed)) as (_, home):  # type: ignore[misc]
            for name, forecasts in learned_by_hours(home, seed, HOURS, days).items():
                one = calibrate(*forecasts)
                found[name].append((one.log_score, one.brier_score))
    steady = np.array(found["no hours"])
    rows = []
    for name, values in found.items():
        log, brier = np.mean(values, axis=0)
        ratio = np.array(values)[:, 0] / steady[:, 0]
        spread = f"{ratio.mean():.3f} ({ratio.min():.3f} to {ratio.max():.3f}) times no hours"
        required, ok = "-", True
        if "map" in name and days == max(DAYS):
            required, ok = "below 1 in the mean", bool(ratio.mean() < 1)
        rows.append(Row(name, f"log score {log:.4f}, Brier {brier:.4f}", spread, required, ok))
    return rows


if __name__ == "__main__":
    main()
