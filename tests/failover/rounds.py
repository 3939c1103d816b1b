"""Rounds of failures under load, and what was lost in them."""

from __future__ import annotations

import time
from collections import defaultdict
from statistics import median
from typing import NamedTuple

from tests.failover.cluster import FailoverCluster
from tests.failover.failures import FAILURES
from tests.failover.writers import Writers, lost_and_double


class Round(NamedTuple):
    """The outcome of one round."""

    failure: str
    acknowledged: int
    lost: int  # acknowledged, but not there at the end
    double: int  # effects of an id beyond the first
    notices: int  # commits whose wait was cancelled
    seconds: float  # the longest time without an acknowledged write
    ready: float  # seconds until all servers follow again


def play(cluster: FailoverCluster, failure: str, acknowledged: set[str]) -> Round:
    """Let a failure happen under load, wait until all servers are back, and compare.

    `acknowledged` has the ids of all rounds before, and gets those of this one.
    """
    with Writers(cluster.url) as writers:
        time.sleep(1)
        FAILURES[failure](cluster, writers)
        over = time.monotonic()
        cluster.wait_until_ready()
        ready = time.monotonic() - over
        time.sleep(1)
    new = {each for _, each in writers.acknowledged}
    acknowledged |= new
    lost, double = lost_and_double(cluster.url, acknowledged)
    return Round(failure, len(new), lost, double, writers.notices, writers.longest_wait(), ready)


def table(rounds: list[Round]) -> str:
    """The rounds by kind of failure, in Markdown."""
    kinds: dict[str, list[Round]] = defaultdict(list)
    for each in rounds:
        kinds[each.failure].append(each)
    kinds["all"] = rounds
    lines = [
        "| failure | rounds | acknowledged | lost | double | without writes p50 | max |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for kind, each in kinds.items():
        seconds = [one.seconds for one in each]
        lines.append(
            f"| {kind} | {len(each)} | {sum(one.acknowledged for one in each):,}"
            f" | {max(one.lost for one in each)} | {max(one.double for one in each)}"
            f" | {median(seconds):.1f} s | {max(seconds):.1f} s |"
        )
    return "\n".join(lines)
