"""Rules on stairs and ramps: the things on them, and the robots that get past these."""

from __future__ import annotations

from collections.abc import Sequence

import shapely

from semmap.geometry.pose import Pose
from semmap.query.geometry_notes import listed
from semmap.query.map_check.building import LINTEL, WALL
from semmap.query.map_check.doorways import GROUND, PASSAGE, SAME
from semmap.query.map_check.fixes import Found
from semmap.query.map_check.reader import CheckedEntity
from semmap.query.map_check.support import SupportedBuilding

WIDTH = 0.9
"""Metres of the width of stairs of which the map states none."""

EVEN = 0.4
"""Metres by which the steps of stairs may be lower than if they rose evenly from end to end."""

STEPS = 0.05
"""Metres to which a gap is measured that is too narrow for a robot, and beneath which is none."""


class Flight:
    """A straight flight of stairs, or a ramp, from one end to the other; heights are z, metres."""

    def __init__(self, ends: Sequence[Pose], width: float) -> None:
        self.width = width
        self.foot, self.rise = ends[0].z, ends[1].z - ends[0].z
        self.line = shapely.LineString([end[:2] for end in ends])
        self.strip = self.line.buffer(width / 2, cap_style="flat")

    @property
    def is_straight(self) -> bool:
        """Whether it is not steeper than its line can be, as stairs are that turn."""
        return bool(self.line.length >= max(abs(self.rise), 0.1))

    def bears(self, thing: CheckedEntity) -> bool:
        """Whether a thing is on the steps, or through them; not what is below or far above."""
        low, high = thing.low[2], thing.high[2]
        if thing.row["structure"] or thing.row["laid"] or high - low <= GROUND:
            return False
        if any(holder.kind == "agent" for holder in thing.chain) or self._is(thing):
            return False
        on = shapely.points(shapely.get_coordinates(thing.ground.intersection(self.strip)))
        if not len(on):
            return False
        steps = self.foot + self.rise * self.line.project(on, normalized=True)
        stands = low >= steps.min() - EVEN
        return bool((stands or high > steps.max() + GROUND) and low < steps.max() + LINTEL)

    def _is(self, thing: CheckedEntity) -> bool:
        """Whether a thing without a type is on most of the way from foot to head: the stairs."""
        if thing.row["type"] not in (None, "object"):
            return False
        along = thing.ground.intersection(self.line).length >= self.line.length / 2
        bottom, top = sorted((self.foot, self.foot + self.rise))
        return bool(along and thing.low[2] <= bottom + 0.3 and thing.high[2] >= top - 0.5)

    def passes(self, width: float, things: Sequence[CheckedEntity]) -> bool:
        """Whether a disc of a width gets from end to end within the sides, past the things."""
        taken = shapely.union_all([e.ground.buffer(width / 2) for e in things])
        free = self.line.buffer(max(self.width - width, SAME) / 2, cap_style="flat")
        ends = shapely.points(self.line.coords)
        return any(
            (shapely.distance(part, ends) <= WALL).all()
            for part in shapely.get_parts(free.difference(taken))
        )


def things_on_stairs(building: SupportedBuilding) -> Found:
    """Stairs and ramps with things on them that leave a robot no way of which nothing is known."""
    for stairs in building.doors:
        if stairs.row["form"] not in ("stairs", "ramp"):
            continue
        assert stairs.pose is not None
        ends = [stairs.pose @ Pose(*stairs.row[f"pose_{end}"]) for end in "ab"]
        flight = Flight(ends, stairs.row["width"] or WIDTH)
        if not flight.is_straight:
            continue
        things = [e for e in building.over(flight.strip) if flight.bears(e)]
        things.sort(key=lambda e: -e.ground.intersection(flight.strip).area)
        least = min(PASSAGE, flight.width) - SAME
        counts = (n for n in range(1, len(things) + 1) if not flight.passes(least, things[:n]))
        shut = things[: next(counts, 0)]
        if not shut:
            continue
        names = tuple(sorted(e.name for e in shut))
        gaps = (k * STEPS for k in range(int(least / STEPS), 0, -1))
        gap = next((gap for gap in gaps if flight.passes(gap, things)), 0.0)
        passes = (
            f"only a robot narrower than {gap + STEPS:.2f} m passes" if gap else "no robot passes"
        )
        stand = "stands" if len(names) == 1 else "stand"
        text = f"{listed(names)} {stand} on the way over {stairs.name}: {passes}"
        yield (stairs.name, *names), text, "by hand: move it off the way, if it is there"
