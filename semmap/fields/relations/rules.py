"""Rules: from which measure on a relation begins, and at which it ends."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Literal

from semmap.fields.regions.region_map import Neighbour, RegionMap

Kind = Literal["body", "part", "space", "view"]
"""An entity with a body; a part of the building, which is in no room; a part of space, such as a
room or zone; the field of view of an agent."""

Measure = Literal["within", "supported", "seen", "voxels apart", "metres apart"]
"""What a rule measures.

- within: share of the voxels of the subject that the object has, 0 to 1
- supported: share of the lowest layer of the subject that rests on the object (`Support`), 0 to 1
- seen: share of the voxels of the object that the subject has, 0 to 1
- voxels apart, metres apart: gap between subject and object
"""

_SLACK = 1e-9  # 0.15 / 0.05 is less than 3


@dataclass(frozen=True)
class PairGeometry:
    """The placement of `a` relative to `b`; support and sizes are measured on demand."""

    regions: RegionMap
    a: Hashable
    b: Hashable
    neighbour: Neighbour

    def measured(self, measure: Measure, active: bool) -> float:
        """Return the value of a measure; `active` states whether the relation has begun."""
        match measure:
            case "within" | "seen":
                if self.neighbour.shared == 0:
                    return 0.0
                return self.neighbour.shared / self.regions.size(
                    self.a if measure == "within" else self.b
                )
            case "supported":
                if not active and self.neighbour.gap > 0:
                    return 0.0
                layer, firm, loose = self.regions.support(self.a, self.b)
                return (loose if active else firm) / layer if layer else 0.0
            case "voxels apart":
                return self.neighbour.gap
            case "metres apart":
                return self.neighbour.gap * self.regions.voxel_size


@dataclass(frozen=True)
class RelationRule:
    """When a relation begins, and when it ends: hysteresis prevents event floods.

    Raises ValueError: the two thresholds are equal, or not finite.
    """

    name: str  # of the relation
    measure: Measure  # the value that is compared with the thresholds
    # begin, end: the relation begins when the measure reaches `begin`, and ends when it is beyond
    # `end`. If `begin` is above `end`, large values make the relation true; else small values
    begin: float
    end: float
    # the kinds of subject and object that can have the relation
    between: frozenset[tuple[Kind, Kind]]

    def __post_init__(self) -> None:
        if not (math.isfinite(self.begin) and math.isfinite(self.end)) or self.begin == self.end:
            raise ValueError(
                f"{self.name} begins at {self.begin!r} and ends beyond {self.end!r}: give two "
                "different numbers, so that small movements do not cause many events"
            )

    def is_true(self, pair: PairGeometry, active: bool) -> bool:
        """Return whether the relation is true; `active` states whether it has begun."""
        value = pair.measured(self.measure, active)
        limit = self.end if active else self.begin
        return value >= limit - _SLACK if self.begin > self.end else value <= limit + _SLACK

    def reach(self, voxel_size: float) -> float:
        """Return the largest gap in metres at which the relation can be true."""
        if self.measure == "metres apart":
            return max(self.begin, self.end)
        return max(self.begin, self.end) * voxel_size if self.measure == "voxels apart" else 0.0


_BODIES: frozenset[tuple[Kind, Kind]] = frozenset(
    {("body", "body"), ("body", "part"), ("part", "body"), ("part", "part")}
)
_INTO_SPACE: frozenset[tuple[Kind, Kind]] = frozenset({("body", "space"), ("space", "space")})
_EITHER: frozenset[tuple[Kind, Kind]] = _BODIES | {
    ("body", "space"),
    ("space", "body"),
    ("part", "space"),
    ("space", "part"),
}
_VIEWED: frozenset[tuple[Kind, Kind]] = frozenset({("view", "body"), ("view", "part")})


RULES = (
    RelationRule("in", "within", 0.9, 0.8, _BODIES),
    RelationRule("in", "within", 0.5, 0.4, _INTO_SPACE),
    RelationRule("on", "supported", 0.1, 0.05, _BODIES),
    RelationRule("touching", "voxels apart", 0.0, 1.0, _BODIES),
    RelationRule("near", "metres apart", 0.5, 0.6, _EITHER),
    RelationRule("sees", "seen", 0.2, 0.1, _VIEWED),
)
"""The rules of all relations.

A body is in one room, see `RelationTracker`. A part of the building is in none, as in the SQL
function `is_in`.
`on` continues where an entity is shifted up or down by a voxel: see `Support.loose`. `sees` uses
the field of view alone; occlusion is not computed.
"""
