"""The world that a building becomes: its entries under unique names, and what is left out."""

from __future__ import annotations

from semmap.geometry.pose import Pose
from semmap.ingest.rmf.alignment import align
from semmap.ingest.rmf.building_file import Building, LevelPlan, Lift
from semmap.ingest.world import OUTSIDE, Entry, Kind, Skipped, World, unique_name

WALL_HEIGHT = 2.5
"""The height at which the traffic editor's own world generator builds walls, metres."""


class BuildingWorld:
    """A world `out` that grows; `storeys` and `elevators` name entries by level and lift."""

    def __init__(self, building: Building) -> None:
        self.building = building
        self.to_map = align(building)
        self.out = World(
            building.name,
            building.path,
            skipped=building.skipped,
            notes=building.notes,
            georeference=building.georeference,
            surveyed=building.georeference is not None,
        )
        self._names: dict[str, Kind | None] = {OUTSIDE: None}
        self.storeys = {
            plan.name: self.add(Entry(plan.name, "storey", "storey", pose=Pose(z=plan.elevation)))
            for plan in building.levels.values()
        }
        self.elevators = {lift.name: self._add_elevator(lift) for lift in building.lifts}

    def add(self, entry: Entry, suffix: str = "") -> str:
        """Add an entry under a free name, with a suffix if another kind has it; return it."""
        wanted = free = entry.name
        if self._names.get(wanted, entry.kind) != entry.kind:
            free += suffix
        entry.name = unique_name(free, self._names)
        if entry.name != wanted:
            entry.label = entry.label or wanted
            if entry.kind != "object":
                self.out.notes.append(f"{wanted}: the name is taken, becomes {entry.name}")
        self._names[entry.name] = entry.kind
        self.out.entries.append(entry)
        return entry.name

    def skip(self, element: str, problem: str, fix: str) -> None:
        """Leave an element out."""
        self.out.skipped.append(Skipped(element, problem, fix))

    def height(self, plan: LevelPlan) -> float:
        """Return the height of walls and rooms: `WALL_HEIGHT`, or up to the next level if lower."""
        above = [o.elevation - plan.elevation for o in self.building.levels.values()]
        return min([WALL_HEIGHT, *(gap for gap in above if gap > 0)])

    def lift_pose(self, lift: Lift) -> Pose:
        """Return the pose of a cabin in the frame of any storey."""
        (x, y), *_ = self.to_map[lift.reference_level].apply([(lift.x, lift.y)])
        return Pose.planar(float(x), float(y), lift.yaw)

    def _add_elevator(self, lift: Lift) -> str:
        initial = self.building.levels.get(lift.initial_level)
        properties = {
            "levels": list(lift.level_doors),
            "initial_level": lift.initial_level,
            "width": lift.width,
            "depth": lift.depth,
        }
        placed = self.lift_pose(lift)._replace(z=initial.elevation if initial else 0.0)
        entry = Entry(lift.name, "elevator", "elevator", properties=properties, pose=placed)
        return self.add(entry)
