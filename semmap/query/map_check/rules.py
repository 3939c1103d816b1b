"""The table of rules by which a map is judged; each looks at geometry, none at derived holders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from semmap.query.map_check.door_rules import (
    blocked_doors,
    doors_at_one_point,
    far_doors,
    level_stairs,
    narrow_doors,
    no_passage,
    overlapping_doors,
    shut_leaves,
    steps_in_doors,
)
from semmap.query.map_check.fixes import Found, Moves, Named, Trials
from semmap.query.map_check.inventory_rules import (
    objects_without_place,
    shapeless_objects,
    stale_poses,
    wrong_holders,
    wrong_rooms,
)
from semmap.query.map_check.reader import read_checked_entities
from semmap.query.map_check.room_rules import (
    improbable_heights,
    one_way_rooms,
    room_pairs,
    rooms_above_rooms,
    rooms_off_storey,
    rooms_without_door,
    shapeless_places,
    storeys_at_one_height,
    storeys_without_floor,
)
from semmap.query.map_check.solid_rules import (
    agents_in_the_air,
    agents_inside,
    floating,
    high_things,
    improbable_sizes,
    outside,
    penetrating,
    sunk,
    things_at_one_point,
    through_ceilings,
    tipping,
)
from semmap.query.map_check.stairs_rules import things_on_stairs
from semmap.query.map_check.support import SupportedBuilding
from semmap.query.snapshot import Snapshot

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One place where a map disagrees with itself or with physics."""

    kind: str  # of the table of rules, such as floating
    severity: Severity  # an error makes answers wrong, a warning can, a note does not
    entities: tuple[str, ...]  # names
    text: str  # a sentence
    fix: str  # the call or statement that repairs it and passes the check, or a step by hand
    safe: bool = False  # `fix` is SQL that changes only data derived from the geometry

    def __str__(self) -> str:
        return f"{self.severity}: {self.kind}: {self.text}"


def check_map(seen: Snapshot) -> list[Finding]:
    """Return what is wrong with the current map: errors first, then warnings and notes."""
    building = SupportedBuilding(read_checked_entities(seen))
    trials = Trials(building, _moved_findings)
    found = []
    for kind, severity, find in RULES:
        for names, text, fix in find(building):
            call = trials.fix(kind, names, fix) if isinstance(fix, Moves) else fix
            found.append(Finding(kind, severity, names, text, call, call.startswith("SELECT ")))
    return found


def _moved_findings(building: SupportedBuilding) -> Named:
    """The findings that a move of an object or door can make or repair."""
    return frozenset(
        (kind, names) for kind, _, find in RULES if kind in MOVED for names, _, _ in find(building)
    )


RULES: tuple[tuple[str, Severity, Callable[[SupportedBuilding], Found]], ...] = (
    ("stale pose", "error", stale_poses),
    ("wrong room", "error", wrong_rooms),
    ("wrong holder", "error", wrong_holders),
    ("identical rooms", "error", partial(room_pairs, same=True)),
    ("door away from its room", "error", far_doors),
    ("blocked door", "error", partial(blocked_doors, structure=True)),
    ("things at one point", "error", things_at_one_point),
    ("doors at one point", "error", doors_at_one_point),
    ("room off its storey", "error", rooms_off_storey),
    ("no passage", "warning", no_passage),
    ("overlapping doors", "warning", overlapping_doors),
    ("narrow door", "warning", narrow_doors),
    ("step in a door", "warning", steps_in_doors),
    ("stairs on one floor", "warning", level_stairs),
    ("shut leaf of an open door", "warning", shut_leaves),
    ("thing in a doorway", "warning", partial(blocked_doors, structure=False)),
    ("thing on stairs", "warning", things_on_stairs),
    ("overlapping rooms", "warning", partial(room_pairs, same=False)),
    ("room without a door", "warning", rooms_without_door),
    ("one-way room", "warning", one_way_rooms),
    ("improbable height", "warning", improbable_heights),
    ("storey without a floor", "warning", storeys_without_floor),
    ("storeys at one height", "warning", storeys_at_one_height),
    ("things without a storey", "warning", high_things),
    ("rooms without storeys", "warning", rooms_above_rooms),
    ("floating", "warning", floating),
    ("tipping", "warning", tipping),
    ("sunk", "warning", sunk),
    ("through a ceiling", "warning", through_ceilings),
    ("penetrating", "warning", penetrating),
    ("agent in a solid", "warning", agents_inside),
    ("agent in the air", "warning", agents_in_the_air),
    ("improbable size", "warning", improbable_sizes),
    ("object without a place", "warning", objects_without_place),
    ("place without geometry", "warning", shapeless_places),
    ("outside of all rooms", "note", outside),
    ("without geometry", "note", shapeless_objects),
)
"""By severity, the gravest first."""


MOVED = {
    "door away from its room",
    "blocked door",
    "no passage",
    "overlapping doors",
    "agent in the air",
    "shut leaf of an open door",
    "thing in a doorway",
    "thing on stairs",
    "things at one point",
    "things without a storey",
    "floating",
    "tipping",
    "sunk",
    "penetrating",
    "agent in a solid",
    "outside of all rooms",
}
"""The kinds that a move of an object or door can change; holders follow it by themselves."""
