"""A process that mirrors a map and follows its topology until standard input ends."""

from __future__ import annotations

import sys
import threading

from planner.live_topology import LiveTopology
from semmap.database import open_engine
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.query.map_handle import MapHandle


def main() -> None:
    """Follow the map of a database: both are arguments; answer each line with a number of looks."""
    engine = open_engine(sys.argv[1], migrate=False)
    mirror = VoxelMirror(engine, sys.argv[2])
    topology = LiveTopology(MapHandle(engine, sys.argv[2]))
    looks = 0

    def look(_: object) -> None:
        nonlocal looks
        looks += 1

    stop = threading.Event()
    threads = [
        threading.Thread(target=mirror.follow, args=(stop, look), kwargs={"save_every": 10.0}),
        threading.Thread(target=topology.follow, args=(stop, look)),
    ]
    for thread in threads:
        thread.start()
    print("ready", flush=True)
    for _ in sys.stdin:
        print(looks, flush=True)
    stop.set()
    for thread in threads:
        thread.join()


if __name__ == "__main__":
    main()
