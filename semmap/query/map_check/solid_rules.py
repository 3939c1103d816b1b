"""Rules on objects: floating, tipping, sunk, penetrating, at one point, outside of rooms."""

from __future__ import annotations

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray

from semmap.geometry.contact import overlap
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.query.geometry_notes import listed
from semmap.query.map_check.building import (
    CEILING,
    CONTACT,
    FASTENED,
    RAISED,
    SAME_POINT,
    STEP,
    THIN,
    WALL,
)
from semmap.query.map_check.fixes import Found, Moves
from semmap.query.map_check.reader import CheckedEntity, once_a_pair
from semmap.query.map_check.support import SupportedBuilding, encloses, sides, thickness

Floats = NDArray[np.float64]

CONTENT = 0.95
"""Part of a solid in another from which it is its content: a coarse box of a cupboard is solid."""

SMALLER = 0.8
"""Of the larger box of two: the largest box of a content. What is larger stands in its place."""

CORE, BODY = 0.05, 0.5
"""Metres around the middle of an agent, and the least height of one; smaller ones stand on it."""

STANDS = 0.1
"""Metres above a stated ceiling that furniture which stands on the floor may be."""

HUGE, TINY = 5.0, 0.1
"""Of the typical size of a type: more or less of it is another type, or another unit."""

LOST = 1000.0
"""Metres above or below all rooms at which no building has a thing."""


def high_things(building: SupportedBuilding) -> Found:
    """Objects far above all floors, as on a storey that is missing in the map."""
    for z, group in building.levels.items():
        names = tuple(e.name for e in group)
        stand = "stands" if len(names) == 1 else "stand"
        text = f"{listed(names)} {stand} at {z:.2f} m, far above all floors: on no storey"
        fix = f"by hand: add a storey at {z:g} m"
        storey = next((s for s in building.storeys if abs(s.low[2] - z) <= STEP), None)
        if storey is not None:
            text += f" with a floor there, though {storey.name} is at this height"
            fix = f"by hand: add rooms or a floor to {storey.name}"
        elif not building.storeys:
            lowest = min(float(e.low[2]) for e in building.solids)
            fix += f", and one for the lowest floor, at about {lowest:.2f} m"
        yield names, text, fix


def floating(building: SupportedBuilding) -> Found:
    """Objects that float: no floor, wall or object bears or holds them."""
    grouped = {e.name for group in building.levels.values() for e in group}
    for entity in building.floating:
        if entity.name in grouped or any(
            _shared(entity, other) is not None
            for other in building.near(entity, 0.0)
            if not _belongs(building, entity, other)
        ):
            continue  # another rule says so
        gap, name = building.gap_beneath(entity)
        beneath = "the floor" if name is None else name
        air = f"{gap:.2f} m above {beneath}" if np.isfinite(gap) else "over nothing"
        text = f"{entity.name} is {air} and hangs on no wall, ceiling or larger thing"
        drops = {gap, building.above_floor(entity)}
        down = [(0, 0, -drop) for drop in sorted(drops) if np.isfinite(drop)]
        yield (entity.name,), text, Moves(entity, down, "put it on what bears it, or delete it")


def tipping(building: SupportedBuilding) -> Found:
    """Objects that tip: their middle is beside the surface that bears them."""
    for entity in building.solids:
        found = None if entity.row["fixture"] else building.overhang(entity)
        if found is not None:
            away, bearer = found
            text = f"the middle of {entity.name} is {away:.2f} m beside {bearer.name}, so it tips"
            inward = ((bearer.low + bearer.high - entity.low - entity.high) / 2)[:2]
            length = max(float(np.linalg.norm(inward)), 1e-9)
            steps = [min((away + more) / length, 1.0) for more in (0.02, 0.05, 0.1, length)]
            by = [(*(inward * step), 0) for step in steps]
            yield (entity.name, bearer.name), text, Moves(entity, by, f"put it on {bearer.name}")


def sunk(building: SupportedBuilding) -> Found:
    """Objects that have sunk into a floor."""
    for entity in building.solids:
        if entity.name in building.sunk:
            place, depth = building.sunk[entity.name]
            floor = f"the floor of {place.name}" if place.kind == "room" else place.name
            text = f"{entity.name} has sunk {depth:.2f} m into {floor}"
            fix = Moves(entity, [(0, 0, depth)], "lift it onto the floor")
            yield (entity.name, place.name), text, fix


def through_ceilings(building: SupportedBuilding) -> Found:
    """Objects in a room that reach through its stated ceiling."""
    stated = {room.name: room for room in building.rooms if room.row["ceiling"] is not None}
    for entity in building.solids:
        for name, share in building.shares(entity).items():
            if name not in stated:
                continue
            over = float(entity.high[2]) - building.ceiling(stated[name])
            stands = entity.low[2] <= building.floor(stated[name]) + STEP
            if (
                over > (STANDS if stands else CEILING)
                and share > 0.5
                and not building.is_part(entity)
            ):
                text = f"{entity.name} reaches {over:.2f} m through the ceiling of {name}"
                fix = "by hand: correct its shape or pose, or the ceiling of the room"
                yield (entity.name, name), text, fix


def penetrating(building: SupportedBuilding) -> Found:
    """Pairs of objects that penetrate each other."""
    done = set()
    for entity in building.solids:
        for other in building.near(entity, 0.0):
            pair = frozenset((entity.name, other.name))
            if pair in done or _belongs(building, entity, other):
                continue
            done.add(pair)
            number = building.together.get(entity.name)
            if number is not None and number == building.together.get(other.name):
                continue  # another rule says so
            shared = _shared(entity, other)
            if shared is None:
                continue
            small, large = sorted(
                (entity, other), key=lambda e: (building.is_part(e), float(np.prod(e.high - e.low)))
            )
            if (
                small.name in building.sunk
                and large.high[2] <= small.low[2] + FASTENED + (building.sunk[small.name][1])
            ):
                continue  # so is the slab of the floor
            size = " x ".join(f"{v:.2f}" for v in shared)
            text = f"{small.name} and {large.name} share a space of {size} m"
            by = _apart(small, large, shared)
            drop = building.above_floor(small)
            if building.gap_beneath(small)[0] > FASTENED and thickness(small) > THIN:
                by = [d if d[2] else d - [0, 0, drop] for d in by if d[2] or np.isfinite(drop)]
            fix = Moves(small, by, "move one of them away")
            yield (small.name, large.name), text, fix


@once_a_pair
def _shared(one: CheckedEntity, two: CheckedEntity) -> Floats | None:
    """The extents of what two solids share; None if it is thin, or in a coarse model of storage."""
    low, high = np.maximum(one.low, two.low), np.minimum(one.high, two.high)
    if (high - low <= CONTACT).any() or not one.ground.intersects(two.ground):
        return None
    found = overlap(one.faces_over(low, high), two.faces_over(low, high), low, high, CONTACT)
    if found is None:
        return None
    extents, *shares = found
    sizes = [float(np.prod(e.high - e.low)) for e in (one, two)]
    for entity, around, share, size in zip((one, two), (two, one), shares, sizes, strict=True):
        within = (entity.low >= low - CONTACT).all() and (entity.high <= high + CONTACT).all()
        if within and share >= CONTENT and size <= SMALLER * max(sizes) and _stores(around, entity):
            return None
    return extents


def _stores(around: CheckedEntity, entity: CheckedEntity) -> bool:
    """Whether a solid stands for one with an inside: by its type, or as its content is stated."""
    stated = entity.row["holder_id"] == around.row["id"] and entity.row["confidence"] is None
    return bool(around.row["storage"]) or (stated and entity.row["relation"] == "in")


def _belongs(building: SupportedBuilding, one: CheckedEntity, two: CheckedEntity) -> bool:
    """Whether both are parts of the building, or one is a fixture: those are built in."""
    fixed = bool(one.row["fixture"]) or bool(two.row["fixture"])
    return fixed or (building.is_part(one) and building.is_part(two))


def things_at_one_point(building: SupportedBuilding) -> Found:
    """Objects of one size at one place."""
    for group in building.one_point:
        names = tuple(e.name for e in group)
        x, y, z = group[0].stand
        last, apart = group[-1], max(group, key=lambda e: float(np.prod(e.high - e.low)))
        by = [d for d in _beside(last, apart) if len(group) == 2]
        fix = Moves(last, by, "move one of them away, or delete it if it is the same")
        away = max(float(np.abs(e.stand - group[0].stand).max()) for e in group)
        text = f"{listed(names)} are at one point: {x:.3f}, {y:.3f}, {z:.3f}"
        if away > SAME_POINT:
            text += f", up to {away:.3f} m apart, and of one size"
        yield names, text, fix


def outside(building: SupportedBuilding) -> Found:
    """Objects outside of all rooms, in the building or beside it."""
    outdoors = []
    for entity in [*building.objects, *building.agents] if building.rooms else ():
        if building.is_part(entity) or building.distance_to_rooms(entity) <= WALL:
            continue
        middle = (entity.low + entity.high) / 2
        within = building.built_over.covers(shapely.Point(*middle[:2]))
        if within or abs(middle[2]) > LOST:
            where = f"{middle[0]:.2f}, {middle[1]:.2f}, {middle[2]:.2f}"
            text = f"{entity.name} is in the building ({where}), but in no room"
            fix = "by hand: move it into a room, or add a room there"
            yield (entity.name,), text, fix
        else:
            outdoors.append(entity.name)
    if outdoors:
        count = f"{len(outdoors)} object{'s are' if len(outdoors) > 1 else ' is'} outside"
        text = f"{count} of the building: {listed(outdoors)}"
        yield tuple(outdoors), text, "by hand: add rooms where robots are to reach them"


def agents_inside(building: SupportedBuilding) -> Found:
    """Robots and people whose middle is in a solid, on which none of them rests."""
    for agent in building.agents:
        body = _core(agent)
        for other in building.near(body, 0.0):
            rests = other.row["rest"] and not agent.row["robot"]  # people sit and lie
            if other.row["fixture"] or rests or agent in other.chain:
                continue  # leaves open, and it carries what it has
            if other.ground.area < body.ground.area - SAME_POINT:
                continue  # a cup in a hand
            stated = agent.row["holder_id"] == other.row["id"] and agent.row["confidence"] is None
            within = not building.is_part(other) and encloses(other, body)
            if stated or not (within or _shared(body, other) is not None):
                continue
            text = f"the middle of {agent.name} is inside {other.name}"
            by = [d for d in _beside(agent, other) if not d[2]]
            yield (agent.name, other.name), text, Moves(agent, by, "correct one of their poses")


def agents_in_the_air(building: SupportedBuilding) -> Found:
    """Robots and people under whom there is air, and who are not on stairs."""
    stairs = [
        shapely.LineString([(door.pose @ Pose(*door.row[f"pose_{end}"]))[:2] for end in "ab"])
        for door in building.doors
        if door.pose is not None and door.row["form"] in ("stairs", "ramp")
    ]
    for agent in building.agents:
        gap, name = building.gap_beneath(agent)
        beneath = "the floor" if name is None else name
        on_stairs = any(line.distance(agent.ground) < WALL for line in stairs)
        if STEP < gap < np.inf and not on_stairs and agent.holder not in building.objects:
            text = f"{agent.name} is {gap:.2f} m above {beneath}"
            yield (agent.name,), text, Moves(agent, [(0, 0, -gap)], "correct its height")


def _core(agent: CheckedEntity) -> CheckedEntity:
    """The upright middle of an agent, above all on which it may stand, as a solid."""
    x, y, z = agent.stand
    height = max(float(agent.high[2]) - z, BODY)
    low = x - CORE, y - CORE, z + min(RAISED, height / 2)
    high = x + CORE, y + CORE, z + height
    mesh = box_mesh(low, high)
    return CheckedEntity(
        agent.name,
        agent.kind,
        {**agent.row, "storage": None},
        triangles=mesh.triangles,
        hull=mesh.vertices,
        outline=shapely.box(*low[:2], *high[:2]),
    )


def improbable_sizes(building: SupportedBuilding) -> Found:
    """Objects much larger or smaller than those of their type, or of its next supertype."""
    for entity in building.objects:
        usual = entity.row["typical"]
        if usual is None or entity.outline is None:
            continue
        size = [*sides(entity), float((entity.high - entity.low)[2])]
        low, high = max(usual) * TINY, max(usual) * HUGE
        wide = sorted(size)[1] > HUGE * sorted(usual)[1]  # rows of shelves are long
        if max(size) >= low and not wide and size[2] <= high:
            continue
        is_, usually = (" x ".join(f"{v:.3g}" for v in each) for each in (size, usual))
        text = f"{entity.name} is {is_} m, but a {entity.row['type']} is usually {usually} m"
        yield (entity.name,), text, "by hand: correct its type, or the size or unit of its shape"


def _apart(small: CheckedEntity, large: CheckedEntity, shared: Floats) -> list[Floats]:
    """Moves of the smaller one out of the other: by what they share, or past its box."""
    by = [
        sign * (float(shared[axis]) + 0.01) * np.eye(3)[axis] for axis in (0, 1) for sign in (-1, 1)
    ]
    return sorted([*by, *_beside(small, large)], key=lambda d: float(np.linalg.norm(d)))


def _beside(small: CheckedEntity, large: CheckedEntity) -> list[Floats]:
    """Moves of one beside the box of another, and onto it; the shortest first."""
    by = [np.array([0, 0, large.high[2] - small.low[2]])]
    for axis in (0, 1):
        for to in (large.high[axis] - small.low[axis], large.low[axis] - small.high[axis]):
            by.append((to + np.sign(to) * (FASTENED + 0.01)) * np.eye(3)[axis])
    return sorted(by, key=lambda d: float(np.linalg.norm(d)))
