"""A process that mirrors a map and follows its topology and a standing query.

It ends with standard input.
"""

from __future__ import annotations

import sys
import threading

from planner.live_topology import LiveTopology
from semmap.database import open_engine
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.knowledge.standing.subscriptions import Subscriptions
from semmap.query.map_handle import MapHandle


def main() -> None:
    """Follow the map of a database: both are arguments; answer each line with what was seen."""
    engine = open_engine(sys.argv[1], migrate=False)
    mirror = VoxelMirror(engine, sys.argv[2])
    topology = LiveTopology(MapHandle(engine, sys.argv[2]))
    standing = Subscriptions(engine, sys.argv[2])
    looks = events = 0

    def event(_: object) -> None:
        nonlocal events
        events += 1

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
    standing.add("SELECT ?object ?x { ?object semmap:placedOn ?y ; semmap:x ?x }", callback=event)
    print("ready", flush=True)
    for _ in sys.stdin:
        print(f"{looks} looks at the map, {events} events", flush=True)
    standing.close()
    stop.set()
    for thread in threads:
        thread.join()


if __name__ == "__main__":
    main()
