"""Judge what is found in walls: ``python -m tests.buildings.found_rooms --count 50``.

Found and known rooms are the same if they share 70 percent of what both cover, doorways if they are
within half a metre; a lift is one if its rooms are cabins.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

import semmap
from navgrid.found_rooms import FoundRooms
from semmap.database import Cluster
from tests.buildings.building import Building, random_building

SHARED, NEAR = 0.7, 0.5


@dataclass(frozen=True)
class Score:
    """How many are known, found, and both."""

    known: int = 0
    found: int = 0
    both: int = 0

    def __add__(self, other: Score) -> Score:
        return Score(self.known + other.known, self.found + other.found, self.both + other.both)

    @property
    def recall(self) -> float:
        """The part of the known that is found."""
        return self.both / max(self.known, 1)

    @property
    def precision(self) -> float:
        """The part of the found that is known."""
        return self.both / max(self.found, 1)


def score_rooms(known: Sequence[shapely.Polygon], found: Sequence[shapely.Polygon]) -> Score:
    """Compare outlines."""
    both = sum(
        any(a.intersection(b).area >= SHARED * a.union(b).area for b in found) for a in known
    )
    return Score(len(known), len(found), both)


def score_doors(
    known: Sequence[Sequence[Sequence[float]]], found: Sequence[Sequence[Sequence[float]]]
) -> Score:
    """Compare the middles of lines (N, 2, 2)."""
    if not known or not found:
        return Score(len(known), len(found))
    a, b = (np.mean(np.asarray(lines, dtype=float)[..., :2], axis=1) for lines in (known, found))
    near = np.hypot(*(a[:, None] - b).transpose(2, 0, 1)) <= NEAR
    return Score(len(a), len(b), int(near.any(axis=1).sum()))


def without_rooms(building: Building, folder: Path) -> tuple[Path, Path]:
    """Write a building as an SDF world and its storeys; its rooms and doors are left out."""
    world, _ = building.write(folder)
    storeys = folder / f"b{building.seed}_storeys.geojson"
    bare = replace(building, rooms=[], doors=[])
    storeys.write_text(json.dumps({"type": "FeatureCollection", "features": list(bare.features())}))
    return world, storeys


def score_lifts(building: Building, found: Sequence[FoundRooms]) -> Score:
    """Compare lifts of several storeys."""
    cabins = [room.outline for room in building.rooms if room.elevator]
    outlines = {room.name: room.outline for storey in found for room in storey.rooms}
    lifts = [[outlines[name] for name in lift.cabins] for each in found for lift in each.lifts]
    right = [all(score_rooms([r], cabins).both for r in rooms) for rooms in lifts]
    return Score(int(len(cabins) > 1), len(lifts), sum(right))


def judge(
    building: Building, database: semmap.Database, folder: Path
) -> tuple[Score, Score, Score]:
    """The scores of rooms, doors and lifts of a building that is imported without them."""
    rooms, doors = Score(), Score()
    name = f"bare{building.seed}"
    for path in without_rooms(building, folder):
        database.import_file(path, map=name)
    found = {each.storey: each for each in database.map(name).find_rooms()}
    database.drop_map(name)
    lifts = score_lifts(building, list(found.values()))
    for storey, _, _ in building.storeys:
        here = found[storey]
        inside = {room.name for room in building.rooms if room.storey == storey}
        rooms += score_rooms(
            [room.outline for room in building.rooms if room.name in inside],
            [room.outline for room in here.rooms],
        )
        doors += score_doors(
            [d.ends for d in building.doors if d.rooms[0] in inside and not d.climbs],
            [way.line.coords for way in here.doorways],
        )
    return rooms, doors, lifts


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.buildings.found_rooms")
    parser.add_argument("--count", type=int, default=50, help="how many buildings")
    parser.add_argument("--first", type=int, default=0, help="the seed of the first")
    given = parser.parse_args()
    rooms, doors, lifts = Score(), Score(), Score()
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)  # another user runs the server where root began it
        cluster = Cluster(Path(folder) / "data")
        with semmap.connect(cluster) as database:
            for seed in range(given.first, given.first + given.count):
                more = judge(random_building(seed), database, Path(folder))
                more_rooms, more_doors, more_lifts = more
                rooms, doors, lifts = rooms + more_rooms, doors + more_doors, lifts + more_lifts
                if min(more_rooms.recall, more_doors.recall, more_rooms.precision) < 0.9:
                    print(seed, more_rooms, more_doors, flush=True)
        cluster.stop()
    for what, score in (("rooms", rooms), ("doors", doors), ("lifts", lifts)):
        print(f"{what}: {score}, recall {score.recall:.3f}, precision {score.precision:.3f}")


if __name__ == "__main__":
    main()
