"""Judge what is found in worlds with known rooms: ``python -m tests.buildings.known_worlds``.

The worlds are below the folder that SEMMAP_WORLDS names. Their rooms and doors are taken away.
Some rooms that a file states are not divided by walls, as a kitchen from a living room; and some
that walls and doorways enclose it does not state, as the bathrooms of a hotel's rooms. The table
counts both, by a section through the walls: `open` are the stated rooms that are missing and whose
border is not at walls and doors; `more` are the rooms that are found, not stated, and whose border
is, or which are such open rooms together. A found room that lies mostly within other stated rooms,
as a half of one or two in one, is wrong, and not more. R' and P' leave out open ones and more;
the last column is the precision P' of those with a confidence above 0.5.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

import semmap
from navgrid.found_rooms import WALLS, FoundRooms, find_rooms
from semmap.database import Cluster
from semmap.query.storey_reader import read_storeys
from semmap.query.storey_scene import SceneEntity, StoreyScene
from tests.buildings.found_rooms import NEAR, SHARED, SURE

OFFICE = Path(__file__).parents[2] / "examples" / "office"

WORLDS = {
    "hotel": ("rmf/hotel/hotel.building.yaml",),
    "clinic": ("rmf/clinic/clinic.building.yaml",),
    "Duplex": ("ifc/Duplex_A_20110907.ifc",),
    "office": (OFFICE / "office.sdf", OFFICE / "office_rooms.geojson"),
    "small_house": (
        "small_house/worlds/small_house.world",
        Path(__file__).parents[1] / "worlds" / "small_house_rooms.geojson",
    ),
}

DRAWN = ("room", "connector", "region")

BESIDE, ENCLOSED, HEIGHT = 0.35, 0.85, 1.0
"""Metres from walls; the part of a border that is so near to them; metres above the floor of the
section through walls."""

MOSTLY = 0.5
"""The part of a found room that stated rooms cover if it is no other room."""

WIDEST = 3.7
"""Metres: a wider opening divides nothing."""


@dataclass(frozen=True)
class Tally:
    """How many are known, found and both; and known but open, found but enclosed and not known.

    Of the others that are found, how many are `sure`, and `right` of them.
    """

    known: int = 0
    found: int = 0
    both: int = 0
    open: int = 0
    more: int = 0
    sure: int = 0
    right: int = 0

    def __add__(self, other: Tally) -> Tally:
        return Tally(*np.add(list(vars(self).values()), list(vars(other).values())).tolist())

    @property
    def rates(self) -> tuple[float, float, float, float, float]:
        """Recall and precision, of all and without those that are open or more; of sure ones."""
        return (
            self.both / max(self.known, 1),
            self.both / max(self.found, 1),
            self.both / max(self.known - self.open, 1),
            self.both / max(self.found - self.more, 1),
            self.right / max(self.sure, 1),
        )

    def __str__(self) -> str:
        counts = (self.known, self.found, self.both, self.open, self.more)
        return "".join(f"{n:6}" for n in counts) + "".join(f"{n:7.3f}" for n in self.rates)


def judge_storey(scene: StoreyScene) -> tuple[Tally, Tally]:
    """Compare the rooms, and the doors, of a storey with those found in its other contents."""
    entities = tuple(e for e in scene.entities if e.kind not in DRAWN)
    try:
        found = find_rooms(replace(scene, entities=entities, floors=()))
    except ValueError:
        found = FoundRooms(scene.storey, scene.elevation)
    doors = [e for e in scene.entities if e.sides is not None and not climbs(e)]
    rooms = [e for e in scene.entities if e.kind == "room" and "elevator_cabin" not in e.types]
    lines = [door_line(door) for door in doors]
    ways = shapely.union_all([line for line in lines if line.length < WIDEST])
    built = shapely.union_all([section(entities, scene.elevation + HEIGHT), ways])
    known = [room.footprint for room in rooms]
    outlines = [room.outline for room in found.rooms]
    same = np.array(
        [[a.intersection(b).area >= SHARED * a.union(b).area for b in outlines] for a in known]
    ).reshape(len(known), len(outlines))
    is_open = np.array([not is_walled(outline, built) for outline in known], bool)
    is_more = np.array([is_walled(outline, built) for outline in outlines], bool)
    is_open &= ~same.any(axis=1)
    stated = [o for o, each in zip(known, is_open, strict=True) if each]
    walled = [o for o, each in zip(known, is_open, strict=True) if not each]
    is_more &= np.array([not lies_in(outline, walled) for outline in outlines], bool)
    is_more |= np.array([are_one(stated, outline) for outline in outlines], bool)
    is_more &= ~same.any(axis=0)
    middles = shapely.centroid(lines)
    doorways = np.array([way.line for way in found.doorways])
    near = shapely.distance(middles[:, None], shapely.centroid(doorways)) <= NEAR
    beside_open = shapely.union_all(stated)
    beside_more = shapely.union_all([o for o, each in zip(outlines, is_more, strict=True) if each])
    lost = shapely.distance(middles, beside_open) <= NEAR
    extra = shapely.distance(doorways, beside_more) <= NEAR
    sure_rooms, sure_ways = (
        np.array([each.confidence > SURE for each in these], bool)
        for these in (found.rooms, found.doorways)
    )
    return tally(same, is_open, is_more, sure_rooms), tally(near, lost, extra, sure_ways)


def tally(
    same: NDArray[np.bool_],
    is_open: NDArray[np.bool_],
    is_more: NDArray[np.bool_],
    sure: NDArray[np.bool_],
) -> Tally:
    """Count those that are the same (known, found), and of the others those open and more."""
    missing, wrong = ~same.any(axis=1), ~same.any(axis=0)
    known, found = same.shape
    return Tally(
        known,
        found,
        int((~missing).sum()),
        int((is_open & missing).sum()),
        int((is_more & wrong).sum()),
        int((sure & ~(is_more & wrong)).sum()),
        int((sure & ~wrong).sum()),
    )


def climbs(connector: SceneEntity) -> bool:
    """Whether it leads from one storey to another."""
    return connector.form in ("stairs", "escalator", "ramp", "ladder")


def door_line(door: SceneEntity) -> shapely.LineString:
    """The line from post to post, across that from one side to the other."""
    assert door.sides is not None
    a, b = (np.array(pose.translation[:2]) for pose in door.sides)
    way = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
    half = (door.width or 0.9) / 2 * np.array([-way[1], way[0]])
    return shapely.LineString([(a + b) / 2 - half, (a + b) / 2 + half])


def section(entities: Sequence[SceneEntity], height: float) -> shapely.Geometry:
    """The lines in which a level plane cuts the surfaces of walls and of what has no type."""
    walls = [e for e in entities if not WALLS.isdisjoint(e.types) or e.types[:1] == ("object",)]
    triangles = np.concatenate([np.empty((0, 3, 3)), *(e.triangles for e in walls)])
    cut = (triangles[..., 2].min(axis=1) < height) & (triangles[..., 2].max(axis=1) > height)
    return shapely.union_all([_cut(each, height) for each in triangles[cut]])


def _cut(triangle: NDArray[np.float64], height: float) -> shapely.LineString:
    points = []
    for p, q in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        if (p[2] < height) != (q[2] < height):
            points.append(p[:2] + (height - p[2]) / (q[2] - p[2]) * (q - p)[:2])
    return shapely.LineString(points)


def is_walled(outline: shapely.Geometry, built: shapely.Geometry) -> bool:
    """Whether walls or doors are beside the border of a room."""
    border = outline.boundary
    points = shapely.line_interpolate_point(border, np.arange(0, border.length, 0.1))
    return bool((shapely.distance(points, built) <= BESIDE).mean() >= ENCLOSED)


def lies_in(part: shapely.Polygon, wholes: Sequence[shapely.Geometry]) -> bool:
    """Whether stated rooms cover most of a found one: it is a half of one, or several."""
    return bool(part.intersection(shapely.union_all(wholes)).area >= MOSTLY * part.area)


def are_one(parts: Sequence[shapely.Geometry], whole: shapely.Polygon) -> bool:
    """Whether those parts that are mostly inside of a whole are it together."""
    inside = [part for part in parts if part.intersection(whole).area >= SHARED * part.area]
    together = shapely.union_all(inside)
    return bool(together.intersection(whole).area >= SHARED * together.union(whole).area)


def judge_world(database: semmap.Database, folder: Path, name: str) -> tuple[Tally, Tally]:
    """The sums of a world's rooms and doors."""
    for file in WORLDS[name]:
        database.import_file(folder / file, map=name)
    with database.map(name).snapshot() as seen:
        scenes = read_storeys(seen)
    judged = [judge_storey(scene) for scene in scenes]
    rooms, doors = (sum(each, Tally()) for each in zip(*judged, strict=True))
    return rooms, doors


def main() -> None:
    """Print the table."""
    names = ("known", "found", "both", "open", "more")
    print(f"{'':20}" + "".join(f"{n:>6}" for n in names) + "      R      P     R'     P'   sure")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)  # another user runs the server where root began it
        cluster = Cluster(Path(folder) / "data")
        with semmap.connect(cluster) as database:
            for name in WORLDS:
                rooms, doors = judge_world(database, Path(os.environ["SEMMAP_WORLDS"]), name)
                print(f"{name + ', rooms':20}{rooms}\n{name + ', doors':20}{doors}", flush=True)
        cluster.stop()


if __name__ == "__main__":
    main()
