"""Try mutated inputs on all that takes input from outside, and print what came of them.

    make fuzz        four minutes; SEMMAP_FUZZ_SECONDS=3600 make fuzz for an hour
    python -m tests.fuzz --kinds sdf,query --seed 7 --jobs 1

Each kind gets as much time. A case may take 5 s of processor time and 1 GB; one that takes more,
ends the process or raises what its caller does not expect is a finding, kept in `tests/fuzz/cases`
and replayed first from then on. The exit status is 1 if there is one.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import threading
import time
from collections import Counter, defaultdict
from pathlib import Path

from tests.fuzz.cases import FOLDER, keep, kept
from tests.fuzz.kinds import KINDS
from tests.fuzz.pool import Result, Worker, encoded

OUTCOMES = ("refused", "accepted", "unexpected", "hang", "memory", "crash")


class Run:
    """Cases of some kinds for some time, by several workers."""

    def __init__(self, kinds: list[str], seconds: float, seed: str, folder: Path) -> None:
        self.kinds, self.seed, self.folder = kinds, seed, folder
        self.end = time.monotonic() + seconds
        self.counts: dict[str, Counter[str]] = defaultdict(Counter)
        self.spent: dict[str, float] = dict.fromkeys(kinds, 0.0)
        self.longest: dict[str, float] = dict.fromkeys(kinds, 0.0)
        self.numbers: Counter[str] = Counter()
        self.findings: dict[tuple[str, ...], list[Path]] = defaultdict(list)
        self.lock = threading.Lock()

    def replay(self, worker: Worker) -> None:
        """The cases that are kept."""
        for case in kept():
            if case.kind in self.kinds:
                result = worker.run({"kind": case.kind, "data": encoded(case.data)})
                self.take(case.kind, result)
                if case.expected not in (None, result.outcome) and not result.is_finding:
                    wrong = Result("unexpected", f"{case.name} is {result.outcome}", case.data, 0)
                    self.take(case.kind, wrong)

    def work(self, worker: Worker) -> None:
        """New cases until the time is over, of the kind that had least of it."""
        while time.monotonic() < self.end:
            with self.lock:
                kind = min(self.kinds, key=self.spent.__getitem__)
                number = self.numbers[kind]
                self.numbers[kind] += 1
                self.spent[kind] += 1e-4  # the other worker takes another kind
            worker.ready()
            start = time.monotonic()
            result = worker.run({"kind": kind, "number": number, "seed": self.seed})
            with self.lock:
                self.spent[kind] += time.monotonic() - start
                self.take(kind, result)

    def take(self, kind: str, result: Result) -> None:
        """Count a result, and keep a finding."""
        self.counts[kind][result.outcome] += 1
        self.longest[kind] = max(self.longest[kind], result.seconds)
        if not result.is_finding:
            return
        places = re.findall(r'File "([^"]+)", line (\d+)', result.text)[-2:]
        last = (result.text.strip().splitlines() or [""])[-1]
        key = (kind, result.outcome, *(":".join(p) for p in places), re.sub(r"\d+", "", last)[:60])
        known = self.findings[key]
        if len(known) < 2:
            path = keep(kind, result.data, f"{result.outcome}: {last}", self.folder)
            known.append(path)
            if len(known) == 1:
                print(
                    f"\n{kind}: {result.outcome}, kept as {path}\n{result.text.strip()[-2500:]}\n",
                    flush=True,
                )

    def table(self) -> str:
        """What was tried, and what came of it."""
        head = ["kind", "cases", *OUTCOMES, "longest"]
        rows = [
            [
                kind,
                sum(self.counts[kind].values()),
                *(self.counts[kind][o] for o in OUTCOMES),
                f"{self.longest[kind]:.1f} s",
            ]
            for kind in self.kinds
        ]
        totals = [sum(int(row[i]) for row in rows) for i in range(1, 2 + len(OUTCOMES))]
        rows.append(["all", *totals, f"{max(self.longest.values()):.1f} s"])
        lines = [
            f"{row[0]:17}" + "".join(f"{cell!s:>11}" for cell in row[1:]) for row in [head, *rows]
        ]
        return "\n".join(lines)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--seconds", type=float, default=float(os.environ.get("SEMMAP_FUZZ_SECONDS", "240"))
    )
    parser.add_argument(
        "--seed", default=str(int(time.time())), help="The same gives the same cases."
    )
    parser.add_argument(
        "--kinds", default="", help="Beginnings of names, with commas; all by default."
    )
    parser.add_argument("--jobs", type=int, default=min(os.cpu_count() or 1, 8))
    parser.add_argument("--keep", type=Path, default=FOLDER, help="Where findings are kept.")
    chosen = parser.parse_args()
    starts = tuple(chosen.kinds.split(","))
    run = Run([k for k in KINDS if k.startswith(starts)], chosen.seconds, chosen.seed, chosen.keep)
    workers = [Worker() for _ in range(chosen.jobs)]
    failed: list[BaseException] = []

    def work(worker: Worker) -> None:
        try:
            run.work(worker)
        except BaseException as error:
            failed.append(error)

    print(f"seed {chosen.seed}, {chosen.seconds:.0f} s, {chosen.jobs} workers", flush=True)
    try:
        run.replay(workers[0])
        threads = [threading.Thread(target=work, args=(worker,)) for worker in workers]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        for worker in workers:
            worker.close()
    if failed:
        raise failed[0]
    print(run.table())
    return 1 if run.findings else 0


if __name__ == "__main__":
    sys.exit(main())
