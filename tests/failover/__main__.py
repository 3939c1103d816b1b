"""Rounds of failures in a cluster of `semmap db cluster`; exit status 1 if anything was lost.

    python -m tests.failover --rounds 100
    python -m tests.failover --rounds 3 --only "switchover"

Needs Docker, and root for what cuts off a server or fills its disk.
"""

from __future__ import annotations

import argparse
import os
import sys

from tests.failover.cluster import running_cluster
from tests.failover.failures import FAILURES
from tests.failover.rounds import Round, play, table


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    default = int(os.environ.get("SEMMAP_ROUNDS", "100"))
    parser.add_argument("--rounds", type=int, default=default, help="of all kinds together")
    parser.add_argument("--only", action="append", choices=[*FAILURES], help="a kind")
    chosen = parser.parse_args()
    kinds = chosen.only or [*FAILURES]
    rounds: list[Round] = []
    acknowledged: set[str] = set()
    try:
        with running_cluster(small_disks=("node2", "node3")) as cluster:
            for number in range(chosen.rounds):
                rounds.append(play(cluster, kinds[number % len(kinds)], acknowledged))
                print(f"{number + 1:>4}  {rounds[-1]}", flush=True)
    finally:
        if rounds:
            print(table(rounds), flush=True)
    return int(any(each.lost or each.double for each in rounds))


if __name__ == "__main__":
    sys.exit(main())
