"""Whether beliefs are calibrated after they learned: homes at random, judged by their moves."""

from __future__ import annotations

from benchmarks.bench_map import fresh_map
from benchmarks.timing import Row, print_rows
from semmap.belief.calibration import calibrate
from tests.households import furnished_home, learned_and_not, unsure

HOMES = 6
GROUPS = 5  # of the forecasts that are unsure


def main() -> None:
    """Print the calibration of beliefs on days that nothing was learned from."""
    rows = []
    for seed in range(HOMES):
        with fresh_map(f"home{seed}", lambda db, seed=seed: furnished_home(db, seed)) as (_, home):  # type: ignore[misc]
            after, before = learned_and_not(home, seed)
        told, off = [], []
        for forecasts in (after, before):
            one, doubtful = calibrate(*forecasts), calibrate(*unsure(forecasts), groups=GROUPS)
            off.append(doubtful.error)
            told.append(
                f"error {one.error:.3f}, of the unsure {doubtful.error:.3f}; "
                f"log score {one.log_score:.3f}"
            )
        # of all forecasts it is small without learning, too: most places surely lack a thing
        required, ok = "of the unsure < 0.05", off[0] < 0.05
        rows.append(Row(f"home {seed}", told[0], f"nothing learned: {told[1]}", required, ok))
    print_rows("Calibration of beliefs, days held out, by moves that the map was not told", rows)


if __name__ == "__main__":
    main()
