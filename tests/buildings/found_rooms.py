"""Judge what is found in walls: ``python -m tests.buildings.found_rooms --count 50``.

Each building is tried empty, furnished, and with partitions, and each of these as meshes and as the
grid that a level scanner of a SLAM program would make of it. The table has recall and precision of
the same rooms and doorways, the recall and precision of areas of Bormann et al. (2016, section
V.B), and the Matthews correlation of MAORIS (Mielle et al., 2018, section III). Those are sure that
have a confidence above 0.5: of them, and of the others, the table has the precision; and the mean
metres between the outlines of the same rooms. A second table compares rooms with those of the
morphological segmentation (`tests.buildings.eroded_rooms`).
Found and known rooms are the same if they share 70 percent of what both cover, doorways if they are
within half a metre; a lift is one if its rooms are cabins.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

import semmap
from navgrid.found_rooms import FoundRooms
from semmap.database import Cluster
from semmap.query.storey_reader import read_storeys
from tests.buildings.building import Building, random_building
from tests.buildings.eroded_rooms import eroded_rooms

SHARED, NEAR = 0.7, 0.5

SCAN = (0.25, 0.35)
"""Metres above the floor that a level scanner sees."""

SURE = 0.5

COLUMNS = (
    *("rooms R", "rooms P", "doors R", "doors P"),
    *("sure rooms", "unsure", "sure doors", "unsure", "outline", "areas R", "areas P", "MCC"),
)


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


def right_rooms(known: Sequence[shapely.Polygon], here: FoundRooms) -> list[tuple[bool, float]]:
    """Whether each found room is a known one, and its confidence."""
    return [(score_rooms(known, [r.outline]).both > 0, r.confidence) for r in here.rooms]


def right_doors(
    known: Sequence[Sequence[Sequence[float]]], here: FoundRooms
) -> list[tuple[bool, float]]:
    """Whether each found doorway is a known one, and its confidence."""
    return [
        (score_doors(known, [way.line.coords]).both > 0, way.confidence) for way in here.doorways
    ]


def apart(known: Sequence[shapely.Polygon], found: Sequence[shapely.Polygon]) -> list[float]:
    """Mean metres from one outline to the other, both ways, of the same rooms."""
    return [
        float(np.mean([_away(a, b), _away(b, a)]))
        for a in known
        for b in found
        if score_rooms([a], [b]).both
    ]


def _away(first: shapely.Polygon, second: shapely.Polygon) -> float:
    border = first.exterior
    points = shapely.line_interpolate_point(border, np.arange(0, border.length, 0.1))
    return float(shapely.distance(points, second.exterior).mean())


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
    known = int(len(cabins) > 1)
    return Score(known, len(lifts), min(known, sum(right)))  # one in two parts is one


def areas(known: Sequence[shapely.Polygon], found: Sequence[shapely.Polygon]) -> list[float]:
    """Mean recall and precision of areas, and mean correlation, of one storey's rooms."""
    if not found:
        return [0.0, 0.0, 0.0]
    shared = shapely.area(shapely.intersection(np.array(known)[:, None], np.array(found)))
    of_known, of_found = shapely.area(known), shapely.area(found)
    best = shared.argmax(axis=1)
    true = shared.max(axis=1)
    missed, more = of_known - true, of_found[best] - true
    beyond = shapely.union_all([*known, *found]).envelope.area - true - missed - more
    sides = (true + more) * (true + missed) * (beyond + more) * (beyond + missed)
    correlation = (true * beyond - more * missed) / np.sqrt(np.maximum(sides, 1e-9))
    within = shared.max(axis=0) / of_found
    return [float((true / of_known).mean()), float(within.mean()), float(correlation.mean())]


@dataclass
class Scores:
    """The sums of all storeys that were judged in one way."""

    rooms: Score = Score()
    doors: Score = Score()
    lifts: Score = Score()
    areas: tuple[list[float], ...] = ()
    right_rooms: tuple[tuple[bool, float], ...] = ()
    right_doors: tuple[tuple[bool, float], ...] = ()
    apart: tuple[float, ...] = ()
    other: Scores | None = None  # of the segmentation to compare with

    def add(self, building: Building, storey: str, here: FoundRooms) -> None:
        """Judge a storey."""
        inside = {room.name for room in building.rooms if room.storey == storey}
        known = [room.outline for room in building.rooms if room.name in inside]
        outlines = [room.outline for room in here.rooms]
        self.rooms += score_rooms(known, outlines)
        doors = [d.ends for d in building.doors if d.rooms[0] in inside and not d.climbs]
        self.doors += score_doors(doors, [way.line.coords for way in here.doorways])
        self.areas += (areas(known, outlines),)
        self.right_rooms += (*right_rooms(known, here),)
        self.right_doors += (*right_doors(doors, here),)
        self.apart += (*apart(known, outlines),)

    @property
    def compared(self) -> tuple[float, float, float]:
        """Recall and precision of rooms, and the correlation of their areas."""
        return self.rooms.recall, self.rooms.precision, float(np.mean(self.areas, axis=0)[2])

    def __str__(self) -> str:
        numbers = [n for s in (self.rooms, self.doors) for n in (s.recall, s.precision)]
        for right in (self.right_rooms, self.right_doors):
            for sure in (True, False):
                these = [each for each, confidence in right if (confidence > SURE) == sure]
                numbers.append(float(np.mean(these)) if these else math.nan)
        numbers += [float(np.mean(self.apart)) if self.apart else math.nan]
        return "  ".join(f"{n:10.3f}" for n in (*numbers, *np.mean(self.areas, axis=0)))


def judge(building: Building, database: semmap.Database, folder: Path, scores: Scores) -> None:
    """Add the scores of a building that is imported without rooms, doors and lifts."""
    with bare(building, database, folder) as house:
        found = house.find_rooms()
        add_other(building, house, None, scores)
    scores.lifts += score_lifts(building, found)
    for each in found:
        scores.add(building, each.storey, each)


def judge_scans(
    building: Building, database: semmap.Database, folder: Path, scores: Scores
) -> None:
    """Add the scores of the grids of a building's storeys."""
    with bare(building, database, folder) as house:
        for storey, _, _ in building.storeys:
            house.grid(storey, interval=SCAN).write(folder / storey)
    for storey, _, _ in building.storeys:
        (file,) = (folder / storey).rglob("map.yaml")
        database.import_file(file, map="scan")
        scan = database.map("scan")
        scores.add(building, storey, scan.find_rooms()[0])
        add_other(building, scan, storey, scores)
        database.drop_map("scan")


def add_other(building: Building, place: semmap.Map, storey: str | None, scores: Scores) -> None:
    """Add the scores of the other segmentation; `storey` is the one that a scan is of."""
    scores.other = scores.other or Scores()
    with place.snapshot() as seen:
        scenes = read_storeys(seen)
    for scene in scenes:
        name = storey or scene.storey
        inside = shapely.union_all([r.outline for r in building.rooms if r.storey == name])
        scores.other.add(building, name, eroded_rooms(scene, inside.buffer(0.3).buffer(-0.3)))


@contextmanager
def bare(building: Building, database: semmap.Database, folder: Path) -> Iterator[semmap.Map]:
    """A map of the building's walls and furniture alone, for a while."""
    name = f"bare{building.seed}"
    for path in without_rooms(building, folder):
        database.import_file(path, map=name)
    yield database.map(name)
    database.drop_map(name)


def furnished(seed: int) -> Building:
    """A building without partitions, whose rooms end at the faces of walls."""
    return random_building(seed, plain=True)


def empty(seed: int) -> Building:
    """It without furniture."""
    building, parts = furnished(seed), ("floor", "wall", "ceiling")
    return replace(building, items=[item for item in building.items if item.what in parts])


STATES = {"empty": empty, "furnished": furnished, "partitioned": random_building}
"""Buildings by seed; those with partitions have outlines that meet in walls, too."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.buildings.found_rooms")
    parser.add_argument("--count", type=int, default=50, help="how many buildings")
    parser.add_argument("--first", type=int, default=0, help="the seed of the first")
    given = parser.parse_args()
    ways = {
        f"{kind}, {state}": (way, made, Scores())
        for kind, way in (("meshes", judge), ("scan", judge_scans))
        for state, made in STATES.items()
    }
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)  # another user runs the server where root began it
        cluster = Cluster(Path(folder) / "data")
        with semmap.connect(cluster) as database:
            for seed in range(given.first, given.first + given.count):
                for way, made, scores in ways.values():
                    way(made(seed), database, Path(folder, str(seed)), scores)
        cluster.stop()
    print(" " * 20, "  ".join(f"{name:>10}" for name in COLUMNS))
    for name, (_, _, scores) in ways.items():
        print(f"{name:20}", scores)
    print(f"\n{'':20}  by doorways: R, P, MCC    by erosion: R, P, MCC")
    for name, (_, _, scores) in ways.items():
        numbers = [*scores.compared, *(scores.other or scores).compared]
        print(f"{name:20}", "".join(f"{n:8.3f}" for n in numbers))
    lifts = ways["meshes, furnished"][2].lifts
    print(f"lifts: {lifts}, recall {lifts.recall:.3f}, precision {lifts.precision:.3f}")


if __name__ == "__main__":
    main()
