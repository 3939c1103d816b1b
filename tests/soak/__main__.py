"""Kill the server and its clients at random moments, and check the map after each kill.

    make soak                             50 kills; SEMMAP_KILLS=1000 make soak for more
    python -m tests.soak --kills 10 --seed 3 --world rooms.geojson --world house.sdf

Writers count their moves, two importers replace one version of a map by another, a mirror stores
itself, a service keeps what a source sees and plays a recording, a poller stores a cursor, and
readers look for a state that contradicts itself. Facts are stated by SPARQL and by HTTP, and a
standing query follows them. The exit status is 1 if anything that was committed is gone, half done
or wrong.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

from semmap.database import Cluster
from tests.cluster_folder import cluster_folder
from tests.soak.bad_machine import jumping_clock, slow_disk
from tests.soak.disk import full_disk, read_only_disk, small_disk
from tests.soak.half_open import half_open
from tests.soak.kills import OFFICE, Soak
from tests.soak.power import damaged


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=int(os.environ.get("SEMMAP_KILLS", "50")))
    parser.add_argument("--cuts", type=int, default=10, help="of the power")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--writers", type=int, default=50)
    parser.add_argument("--readers", type=int, default=10)
    parser.add_argument("--world", type=Path, action="append", help="A file to import.")
    chosen = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="semmap-soak-", dir="/tmp"))
    folder.chmod(0o755)
    print(f"seed {chosen.seed}, {chosen.kills} kills", flush=True)
    cluster = Cluster(folder / "home")
    soak = Soak(cluster, folder, chosen.world or OFFICE, chosen.seed)
    try:
        soak.prepare(chosen.writers, chosen.readers)
        for number in range(chosen.kills):
            print(f"{number + 1:>5}  {soak.kill()}", flush=True)
        soak.use_small_buffers()
        for number in range(chosen.cuts):
            print(f"{number + 1:>5}  {soak.cut_power()}", flush=True)
        soak.finish()
        soak.wrong += [*damaged(cluster), *half_open(Cluster(folder / "other"))]
    finally:
        soak.close()
        cluster.stop()
        shutil.rmtree(folder)
    print(soak.table(), flush=True)
    wrong = []
    with small_disk() as disk:
        if disk is None:
            print("full and read-only disks are not tested: only root can mount one")
        else:
            wrong += [*full_disk(disk), *read_only_disk(disk)]
    for trial in (slow_disk, jumping_clock):
        with cluster_folder(Path("/tmp")) as folder:
            wrong += trial(folder, chosen.seed)
    print("\n".join(wrong) or "bad disks and clocks: nothing was lost, half done or wrong")
    return 1 if soak.wrong or wrong else 0


if __name__ == "__main__":
    sys.exit(main())
