"""Judge the maps of many random buildings: ``python -m tests.buildings --count 200``."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path

from semmap.database import Cluster
from tests.buildings.building import random_building
from tests.buildings.clouds import scanned
from tests.buildings.judges import JUDGES, stored

parser = argparse.ArgumentParser(prog="python -m tests.buildings", description=__doc__)
parser.add_argument("--count", type=int, default=200, help="how many buildings")
parser.add_argument("--first", type=int, default=0, help="the seed of the first")
given = parser.parse_args()

asked: Counter[str] = Counter()
wrong: Counter[str] = Counter()
seconds: Counter[str] = Counter()
with tempfile.TemporaryDirectory() as folder:
    Path(folder).chmod(0o755)  # another user runs the server where root began it
    cluster = Cluster(Path(folder) / "data")
    for seed in range(given.first, given.first + given.count):
        building = scanned(random_building(seed))
        with stored(building, cluster, Path(folder)) as place:
            for judge in JUDGES:
                start = time.perf_counter()
                questions, sentences = judge(building, place)
                seconds[judge.__name__] += time.perf_counter() - start
                asked[judge.__name__] += questions
                wrong[judge.__name__] += len(sentences)
                for sentence in sentences:
                    print(f"{building.seed} {judge.__name__}: {sentence}", flush=True)
            place.database.drop_map(place.name)
    cluster.stop()
print(f"{'judge':16}{'asked':>10}{'wrong':>8}{'s':>8}   {given.count} buildings")
for judge in JUDGES:
    name = judge.__name__
    print(f"{name:16}{asked[name]:>10}{wrong[name]:>8}{seconds[name]:>8.0f}")
raise SystemExit(bool(wrong.total()))
