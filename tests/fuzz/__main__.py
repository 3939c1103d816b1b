"""Try mutated inputs on all that takes input from outside, and print what came of them.

    make fuzz        four minutes; SEMMAP_FUZZ_SECONDS=3600 make fuzz for an hour
    SEMMAP_FUZZ_CASES=1000000 make fuzz    so many cases; interrupted, it goes on where it was
    make fuzz-sanitized                    native functions, their memory and arithmetic checked
    python -m tests.fuzz --kinds sdf,query --seed 7 --jobs 1

Each kind gets as much time. A case may take 5 s of processor time and 1 GB; one that takes more,
ends the process or raises what its caller does not expect is a finding, kept in `tests/fuzz/cases`
and replayed first from then on. The exit status is 1 if there is one.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import threading
import time
from collections import Counter, defaultdict
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from tests.fuzz.cases import FOLDER, keep, kept
from tests.fuzz.kinds import KINDS
from tests.fuzz.pool import Result, Worker, encoded
from tests.fuzz.server import served

PROGRESS = Path("build/fuzz.json")
"""Where a run of a number of cases stores how far it is."""

REPORT_SECONDS = 60.0
OUTCOMES = ("refused", "accepted", "unexpected", "hang", "memory", "crash")


class Run:
    """Cases of some kinds, for some time or until there are so many, by several workers.

    Parameters
    ----------
    progress : a file that has how far the run is; a run that finds one goes on there
    """

    def __init__(
        self,
        kinds: list[str],
        seconds: float,
        seed: str,
        folder: Path,
        cases: float = float("inf"),
        progress: Path | None = None,
    ) -> None:
        self.kinds, self.seed, self.folder = kinds, seed, folder
        self.cases, self.progress = cases, progress
        self.end = time.monotonic() + seconds
        self.counts: dict[str, Counter[str]] = defaultdict(Counter)
        self.spent: dict[str, float] = dict.fromkeys(kinds, 0.0)
        self.longest: dict[str, float] = dict.fromkeys(kinds, 0.0)
        self.numbers: Counter[str] = Counter()
        self.findings: dict[tuple[str, ...], list[Path]] = defaultdict(list)
        self.lock = threading.Lock()
        self.again: list[tuple[str, int]] = []
        self.running: set[tuple[str, int]] = set()
        self.stored = time.monotonic()
        if progress is not None and progress.exists():
            self.resume(json.loads(progress.read_text("utf-8")))

    @property
    def done(self) -> int:
        """The number of cases that were tried."""
        return sum(sum(counts.values()) for counts in self.counts.values())

    def resume(self, stored: dict[str, Any]) -> None:
        """Go on where a run was that stored this; its cases that had not ended run again."""
        self.seed = stored["seed"]
        self.again = [(kind, number) for kind, number in stored["running"] if kind in self.kinds]
        self.numbers.update(stored["numbers"])
        for kind, counts in stored["counts"].items():
            self.counts[kind].update(counts)
        self.spent |= {kind: s for kind, s in stored["spent"].items() if kind in self.kinds}
        self.longest |= stored["longest"]

    def store(self) -> None:
        """Write how far the run is, whole or not at all."""
        self.stored = time.monotonic()
        if self.progress is None:
            return
        state = {
            "seed": self.seed,
            "numbers": self.numbers,
            "running": [*self.running, *self.again],
            "counts": self.counts,
            "spent": self.spent,
            "longest": self.longest,
        }
        self.progress.parent.mkdir(parents=True, exist_ok=True)
        new = self.progress.with_suffix(".new")
        new.write_text(json.dumps(state), "utf-8")
        new.replace(self.progress)

    def next(self) -> tuple[str, int]:
        """The next case: of the kind that had least time."""
        if self.again:
            case = self.again.pop()
        else:
            kind = min(self.kinds, key=self.spent.__getitem__)
            case = (kind, self.numbers[kind])
            self.numbers[kind] += 1
        self.running.add(case)
        self.spent[case[0]] += 1e-4  # the other worker takes another kind
        return case

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
        """New cases until the time is over, or until there are enough."""
        while time.monotonic() < self.end:
            with self.lock:
                if self.done + len(self.running) >= self.cases:
                    return
                kind, number = self.next()
            worker.ready()
            start = time.monotonic()
            result = worker.run({"kind": kind, "number": number, "seed": self.seed})
            with self.lock:
                self.spent[kind] += time.monotonic() - start
                self.running.remove((kind, number))
                self.take(kind, result)
                if time.monotonic() - self.stored > REPORT_SECONDS:
                    self.store()
                    found = sum(map(len, self.findings.values()))
                    print(f"{self.done:,} cases, {found} findings", flush=True)

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


def try_cases(run: Run, jobs: int) -> None:
    """Let workers do a run."""
    workers = [Worker() for _ in range(jobs)]
    failed: list[BaseException] = []

    def work(worker: Worker) -> None:
        try:
            run.work(worker)
        except BaseException as error:
            failed.append(error)

    try:
        if not run.done:
            run.replay(workers[0])
        threads = [threading.Thread(target=work, args=(worker,)) for worker in workers]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        run.store()
        for worker in workers:
            worker.close()
    if failed:
        raise failed[0]


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--cases",
        type=int,
        default=int(os.environ.get("SEMMAP_FUZZ_CASES", "0")),
        help=f"So many instead of a time; {PROGRESS} has how far it is.",
    )
    parser.add_argument("--seconds", type=float, default=os.environ.get("SEMMAP_FUZZ_SECONDS"))
    parser.add_argument(
        "--seed", default=str(int(time.time())), help="The same gives the same cases."
    )
    parser.add_argument(
        "--kinds", default="", help="Beginnings of names, with commas; all by default."
    )
    parser.add_argument("--jobs", type=int, default=min(os.cpu_count() or 1, 8))
    parser.add_argument("--keep", type=Path, default=FOLDER, help="Where findings are kept.")
    parser.add_argument("--progress", type=Path, default=PROGRESS, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    starts = tuple(chosen.kinds.split(","))
    seconds = chosen.seconds or (float("inf") if chosen.cases else 240.0)
    kinds = [kind for kind in KINDS if kind.startswith(starts)]
    if not kinds:
        parser.error(f"no kind begins with {chosen.kinds}: choose of {', '.join(KINDS)}")
    run = Run(
        kinds,
        seconds,
        chosen.seed,
        chosen.keep,
        chosen.cases or float("inf"),
        chosen.progress if chosen.cases else None,
    )
    most = f"{chosen.cases:,} cases" if chosen.cases else f"{seconds:.0f} s"
    begun = f", {run.done:,} done before" if run.done else ""
    print(f"seed {run.seed}, {most}{begun}, {chosen.jobs} workers", flush=True)
    with served() if any(KINDS[kind].server for kind in run.kinds) else nullcontext():
        try_cases(run, chosen.jobs)
    print(run.table())
    return 1 if run.findings else 0


if __name__ == "__main__":
    sys.exit(main())
