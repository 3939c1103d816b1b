"""A sound building, and the faults that are planted in it for the tests of `Map.check`."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import semmap
from semmap.geometry.mesh import box_mesh, join
from tests.forged import forge

NAMES = ("slab", "Wand", "estantería", "x17", "concrete_base", "Möbel", "cosa")
"""Names and types say nothing to the check: they are drawn at random."""


def sound_building(db: semmap.Database, seed: int) -> semmap.Map:
    """A sound building: rooms in a row on storeys, walls, floors, furniture, things on it."""
    draw = random.Random(seed)
    here = db.create_map(f"b{seed}")
    for level in range(draw.randint(1, 2)):
        z = 3.2 * level
        here.add_storey(f"s{level}", elevation=z, height=3.0)
        x, count = 0.0, draw.randint(2, 4)
        width = [draw.uniform(3, 6) for _ in range(count)]
        depth = draw.uniform(3.5, 6)
        slab = box_mesh((-0.2, -0.2, -0.2), (sum(width) + 0.2 * count, depth + 0.2, 0))
        here.add_object(f"{draw.choice(NAMES)} f{level}", mesh=slab, pose=(0, 0, z), type="floor")
        for number, wide in enumerate(width):
            name = f"r{level}{number}"
            outline = [(x, 0), (x + wide, 0), (x + wide, depth), (x, depth)]
            here.add_room(name, outline, floor=z, ceiling=z + 2.9, storey=f"s{level}")
            parts = [
                box_mesh((x + wide, 1.2, 0), (x + wide + 0.2, depth, 2.9)),
                box_mesh((x + wide, 0, 0), (x + wide + 0.2, 0.2, 2.9)),
            ]
            wall = f"{draw.choice(NAMES)} w{level}{number}"
            here.add_object(wall, mesh=join(parts), pose=(0, 0, z), type="wall")
            if number:
                line = ((x - 0.1, 0.2), (x - 0.1, 1.2))
                here.add_door(f"d{level}{number}", f"r{level}{number - 1}", name, line, height=z)
            _furnish(here, draw, name, x, z, wide, depth)
            x += wide + 0.2
        if level:
            here.add_door("up", "r00", "r10", ((0.5, 0.5), (2.0, 0.5)), form="stairs", height=0)
    return here


def _furnish(
    here: semmap.Map, draw: random.Random, name: str, x: float, z: float, wide: float, depth: float
) -> None:
    table, yaw = f"t{name}", draw.uniform(-0.3, 0.3)
    legs = [
        box_mesh((u, v, 0), (u + 0.05, v + 0.05, 0.7)) for u in (-0.5, 0.45) for v in (-0.3, 0.25)
    ]
    top = box_mesh((-0.5, -0.3, 0.7), (0.5, 0.3, 0.74))
    here.add_object(table, mesh=join([*legs, top]), pose=(x + wide / 2, depth / 2, z, yaw))
    here.add_object(f"c{name}", size=(0.08, 0.08, 0.1), on=table)
    here.add_object(f"p{name}", size=(0.4, 0.03, 0.5), pose=(x + wide / 2, depth - 0.02, z + 1.4))
    here.add_object(f"l{name}", size=(0.3, 0.3, 0.2), pose=(x + wide / 2, depth / 2, z + 2.6))


def floats(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    here["cr01"].move_to(*free_spot(here, "r01"), draw.uniform(0.2, 1.5))
    return "floating", {"cr01"}


def sinks(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    x, y = free_spot(here, "r01")
    here.add_object("chest", size=(0.6, 0.5, 0.5), pose=(x, y, 0, draw.uniform(0, 3)))
    here.add_object("crate", size=(0.5, 0.5, 0.4), pose=(x + 0.3, y + 0.1, 0, draw.uniform(0, 3)))
    return "penetrating", {"chest", "crate"}


def stands_in_a_wall(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    _, _, high, _ = here["r00"].footprint.bounds  # type: ignore[union-attr]
    wall = next(e.name for e in here.objects if e.name.endswith(" w00"))
    here.add_object("chest", size=(0.5, 0.4, 0.5), pose=(high - 0.1, 2.5, 0))
    return "penetrating", {"chest", wall}


def coincides(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    pose = here["cr00"].pose
    assert pose is not None
    here.add_object("twin", size=(0.06, 0.05, 0.04), pose=(pose.x, pose.y, pose.z))
    return "things at one point", {"twin", "cr00"}


def is_drawn_twice(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    outline = here["r00"].footprint
    here.add_room("again", outline, floor=0, ceiling=2.9)  # type: ignore[arg-type]
    here.add_door("da", "again", "r01", here["d01"].geometry.coords)
    return "identical rooms", {"again", "r00"}


def overlaps(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    outline = here["r00"].footprint
    assert outline is not None
    low, _, _, top = outline.bounds
    edge = draw.uniform(0.7, 0.9)
    corners = [
        (low - 3, top - edge),
        (low + 0.9, top - edge),
        (low + 0.9, top + 3),
        (low - 3, top + 3),
    ]
    here.add_room("annex", corners, floor=0, ceiling=2.9)
    here.add_door("da", "annex", "r00", ((low, top - 0.65), (low, top)))
    return "overlapping rooms", {"annex", "r00"}


def is_a_second_door(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    pose = here["d01"].pose
    assert pose is not None
    x = pose.x + draw.uniform(-0.05, 0.05)
    here.add_door("again", "r01", "r00", ((x, 1.2), (x, 0.2)))
    return "doors at one point", {"again", "d01"}


def is_too_high(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    for slab in [e for e in here.objects if e.name.endswith(" f1")]:
        slab.delete()  # else it penetrates that, too
    low, _, _, top = here["r01"].footprint.bounds  # type: ignore[union-attr]
    height = draw.uniform(3.5, 5)
    here.add_object("locker", size=(0.5, 0.4, height), pose=(low + 0.4, top - 0.3, 0))
    return "through a ceiling", {"locker", "r01"}


def has_no_door(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    here.add_room("vault", [(0, -4), (3, -4), (3, -1), (0, -1)], floor=0, ceiling=2.9)
    return "room without a door", {"vault"}


def leads_past(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    pose = here["d01"].pose
    assert pose is not None
    here["d01"].move_to(pose.x + draw.uniform(0.5, 1.0), pose.y, pose.z)
    return "door away from its room", {"d01", "r00"}


def has_no_floor(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    here.add_storey("loft", elevation=draw.uniform(7, 9))
    return "storey without a floor", {"loft"}


def is_between_walls(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    here.add_room("far", [(0, -6), (9, -6), (9, -2), (0, -2)], floor=0, ceiling=2.9)
    here.add_door("df", "far", None, ((3, -6), (4, -6)))
    here.add_door("gate", "r00", None, ((1, 0), (2, 0)))
    here.add_object("lost", size=(0.2, 0.2, 0.2), pose=(1, -1, 0))
    return "outside of all rooms", {"lost"}


def belongs_to_a_storey_below(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    top = here.add_storey("top", elevation=draw.uniform(20, 30))
    z = top.pose.z  # type: ignore[union-attr]
    here.add_room("attic", [(0, 0), (3, 0), (3, 3), (0, 3)], floor=z, ceiling=z + 2)
    here.add_door("da", "attic", None, ((1, 0), (2, 0)), height=z)
    here.add_door("gate", "r00", None, ((1, 0), (2, 0)))
    here.execute("SELECT put(%s, %s)", here["attic"].id, here["s0"].id)
    return "room off its storey", {"attic", "s0"}


def is_held_elsewhere(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    here.execute("SET semmap.deriving = 'on'")  # a holder that no rule derives
    here.execute("SELECT put(%s, %s, 'in', 1)", here["cr00"].id, here["s0"].id)
    here.execute("SET semmap.deriving = ''")
    return "wrong room", {"cr00"}


def is_stale(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    forge(
        here.execute,
        "UPDATE world SET pose[1] = pose[1] + 0.01 WHERE entity_id = %s",
        here["cr00"].id,
    )
    return "stale pose", {"cr00"}


def is_a_copy(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    x, y = free_spot(here, "r01")
    size = (draw.uniform(0.1, 1), draw.uniform(0.1, 0.5), draw.uniform(0.1, 0.9))
    here.add_object("chair", size=size, pose=(x, y, 0))
    here.add_object("again", size=size, pose=(x + draw.uniform(0.003, 0.03), y, 0.001))
    return "things at one point", {"chair", "again"}


def stands_in_the_middle_of_a_wall(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    wall = next(e for e in here.objects if e.name.endswith(" w00"))
    assert wall.footprint is not None
    x0, y0, x1, y1 = wall.footprint.bounds
    here.add_object("chest", size=(0.5, 0.4, 0.5), pose=((x0 + x1) / 2, (y0 + y1) / 2, 0))
    return "penetrating", {"chest", wall.name}


def floats_with_a_cup(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    pose = here["tr01"].pose
    assert pose is not None
    here["tr01"].move_to(pose.x, pose.y, draw.uniform(0.1, 1.2))
    holder = here["cr01"].holder
    assert holder is not None
    assert holder.name == "tr01"
    return "floating", {"tr01"}


def sinks_into_the_floor(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    deep = draw.choice([0.3, 0.5, draw.uniform(0.06, 0.5)])
    here.add_object("chest", size=(0.5, 0.5, 0.5), pose=(*free_spot(here, "r01"), -deep))
    return "sunk", {"chest", "r01"}


def stands_in_a_door(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    """A wall, of which less is left beside than a robot needs; its ends may be anywhere."""
    pose = here["d01"].pose
    assert pose is not None
    left = draw.uniform(-0.4, 0.5)  # of the opening of one metre
    low, high = (left, 1.3) if draw.random() < 0.5 else (-0.3, 1 - left)
    thick, x = draw.choice([(0.1, 0.0), (3.0, 0.0), (0.08, 0.2)])
    mesh = box_mesh((x - thick / 2, low - 0.5, 0), (x + thick / 2, high - 0.5, 2.9))
    for thing in ("tr00", "cr00", "tr01", "cr01"):  # a thick one would be in them
        here[thing].delete()
    here.add_object("bar", mesh=mesh, pose=(pose.x, pose.y, 0), type="wall")
    return "blocked door", {"bar", "d01"}


def is_for_mice(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    here.execute(
        "UPDATE connector SET width = %s WHERE entity_id = %s",
        draw.uniform(0.01, 0.19),
        here["d01"].id,
    )
    return "no passage", {"d01"}


def add_exit(here: semmap.Map, draw: random.Random, name: str) -> float:
    """Add a door to the outside of a room; return where the door to the other room is, in x."""
    pose = here["d01"].pose
    assert pose is not None
    x = pose.x - draw.uniform(0.6, 1.0)
    here.add_door(name, "r00", None, ((x - 1, 0), (x, 0)))
    return pose.x


def ends_beside_its_room(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    add_exit(here, draw, "wide")
    here.execute("UPDATE connector SET width = 9 WHERE entity_id = %s", here["wide"].id)
    return "no passage", {"wide"}


def joins_its_room_with_itself(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    x = add_exit(here, draw, "out")
    here.add_door("within", "r01", "r01", ((x + 1.3, 0.9), (x + 2.1, 0.9)))
    here.execute("UPDATE connector SET place_b = place_a WHERE entity_id = %s", here["out"].id)
    return "no passage", {"out"}


def is_put_in_a_door(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    pose = here["d01"].pose
    assert pose is not None
    size = (0.3, draw.uniform(0.5, 0.9), draw.uniform(0.3, 1.2))
    here.add_object("cart", size=size, pose=(pose.x, pose.y, 0))
    return "thing in a doorway", {"cart", "d01"}


def tips(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    pose = here["tr01"].pose
    assert pose is not None
    side = draw.uniform(0.06, 0.1)
    for name, share in (("mug", draw.uniform(0.65, 0.9)), ("jar", draw.uniform(0.1, 0.4))):
        end = 1 if name == "mug" else -1  # of the table, which is one metre long
        x, y, _ = pose.apply([[end * (0.5 + (share - 0.5) * side), 0, 0]])[0]
        yaw = 2 * math.atan2(pose.qz, pose.qw)
        here.add_object(name, size=(side, side, 0.1), pose=(x, y, 0.74, yaw))
    return "tipping", {"mug", "tr01"}


def has_no_place(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    here.add_object("ghost", size=(draw.uniform(0.1, 2), 0.5, 0.5))
    here.add_object("believed", type="mug")  # neither a shape nor a place: it is searched for
    return "object without a place", {"ghost"}


def leads_nowhere(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    pose = here["d01"].pose
    assert pose is not None
    y = pose.y + draw.uniform(1.5, 2.0)
    form = draw.choice(["stairs", "ramp"])
    wall = next(e for e in here.objects if e.name.endswith(" w00"))
    wall.delete()
    here.add_door("level", "r00", "r01", ((pose.x, y), (pose.x, y + 0.9)), form=form)
    return "stairs on one floor", {"level", "r00", "r01"}


def has_one_leaf_shut(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    """Of two leaves of a wide door one is open: the other closes a part of it."""
    walls = [e.name for e in here.objects if e.name.endswith(" w00")]
    for name in (*walls, "tr01", "cr01"):  # the open leaf would be in the table
        here[name].delete()
    door, x = here["d01"], here["d01"].pose.x  # type: ignore[union-attr]
    door.delete()
    here.add_door("wide", "r00", "r01", ((x, 0.3), (x, 2.3)))
    shut = draw.choice([0.5, 0.7, 1.0, 1.3])
    leaf = box_mesh((-0.02, 0.3, 0), (0.02, 0.3 + shut, 2))
    ajar = box_mesh((0.0, 2.26, 0), (2 - shut, 2.3, 2))
    here.add_object("leaf", type="door_leaf", mesh=leaf, pose=(x, 0, 0))
    here.add_object("ajar", type="door_leaf", mesh=ajar, pose=(x, 0, 0))
    return "shut leaf of an open door", {"wide", "leaf"}


def is_in_a_cabinet(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    x, y = free_spot(here, "r01")
    type_ = draw.choice(["cabinet", "object"])
    here.add_object("locker", type=type_, size=(0.9, 0.8, 2), pose=(x, y, 0, draw.uniform(-3, 3)))
    size = draw.choice([None, (0.3, 0.3, 1.2), (0.5, 0.5, 0.12), (0.5, 0.5, 1.8)])
    here.add_agent("who", size=size, pose=(x + draw.uniform(-0.1, 0.1), y, 0))
    return "agent in a solid", {"who", "locker"}


def is_huge(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    size = draw.choice([(0.8, 0.9, 1.0), (0.1, 0.1, 2.0), (0.9, 0.9, 0.1), (0.001, 0.001, 0.0015)])
    here.add_object("mug", type="mug", size=size, pose=(*free_spot(here, "r01"), 0))
    return "improbable size", {"mug"}


def is_there_twice(here: semmap.Map, draw: random.Random) -> tuple[str, set[str]]:
    here.add_storey("twin", elevation=draw.uniform(-0.02, 0.02))
    return "storeys at one height", {"twin", "s0"}


Fault = Callable[[semmap.Map, random.Random], tuple[str, set[str]]]
"""Plants a fault; the kind of finding that it is, and the entities concerned."""

FAULTS: list[Fault] = [
    floats,
    sinks,
    stands_in_a_wall,
    coincides,
    is_drawn_twice,
    overlaps,
    is_a_second_door,
    is_too_high,
    has_no_door,
    leads_past,
    has_no_floor,
    is_between_walls,
    belongs_to_a_storey_below,
    is_held_elsewhere,
    is_stale,
    is_a_copy,
    stands_in_the_middle_of_a_wall,
    floats_with_a_cup,
    sinks_into_the_floor,
    tips,
    stands_in_a_door,
    is_put_in_a_door,
    is_for_mice,
    ends_beside_its_room,
    joins_its_room_with_itself,
    has_no_place,
    leads_nowhere,
    has_one_leaf_shut,
    is_in_a_cabinet,
    is_huge,
    is_there_twice,
]


def free_spot(here: semmap.Map, room: str) -> tuple[float, float]:
    """The middle of a room's front, far from table and walls."""
    outline = here[room].footprint
    assert outline is not None
    low, bottom, high, _ = outline.bounds
    return (low + high) / 2, bottom + 0.7
