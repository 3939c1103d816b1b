"""Parts of the building are recognised in whatever order, and however often, they are added."""

from __future__ import annotations

import random

import pytest
import shapely

import semmap
from semmap.geometry.mesh import prism_mesh
from tests.buildings.found_rooms import score_rooms

WALL = ("zzp", (0.1, 8.0, 2.7), (5.0, 4.0, 0.0, 0.0))
FLOOR = ("qxv", (10.4, 8.4, 0.2), (5.0, 4.0, -0.2, 0.0))
SHELF = ("schr", (0.6, 2.0, 2.2), (8.5, 2.0, 0.0, 0.0))
ROOMS = {"a": (0.0, 4.95), "b": (5.05, 10.0)}


def add(place: semmap.Map, what: str) -> None:
    if what == "rooms":
        for name, (x0, x1) in ROOMS.items():
            outline = [(x0, 0), (x1, 0), (x1, 8), (x0, 8)]
            place.add_room(name, outline, floor=0, ceiling=2.7)
        return
    name, size, pose = {"wall": WALL, "floor": FLOOR, "shelf": SHELF}[what]
    place.add_object(name, size=size, pose=pose)


@pytest.mark.parametrize("turn", range(4))
def test_the_order_tells_nothing(database: str, turn: int) -> None:
    order = ["rooms", "wall", "floor", "shelf"]
    order = order[turn:] + order[:turn]
    with semmap.connect(database) as db:
        for again in range(2):  # the second map finds the meshes of the first
            place = db.create_map(f"parts {turn} {again}")
            place.add_storey("s", elevation=0, height=2.7)
            for what in order:
                add(place, what)
            assert (place["zzp"].type, place["qxv"].type) == ("wall", "floor")
            holders = {name: place[name].holder for name in ("zzp", "qxv", "schr")}
            assert {name: holder and holder.name for name, holder in holders.items()} == {
                "zzp": "s",
                "qxv": "s",
                "schr": "b",
            }
            place["zzp"].delete()
            add(place, "wall")
            assert place["zzp"].type == "wall"


def types(place: semmap.Map) -> dict[str, tuple[str, str | None]]:
    holders = {name: place[name].holder for name in ("zzp", "qxv", "schr")}
    return {n: (place[n].type or "object", h and h.name) for n, h in holders.items()}


@pytest.mark.parametrize("seed", range(6))
def test_moves_tell_nothing_but_where_things_are(database: str, seed: int) -> None:
    """After random moves, everything is what it is in a map where it was put there at once."""
    draw = random.Random(seed)
    spots = [0.0, 3.0, draw.uniform(-4, 4), 20.0]
    with semmap.connect(database) as db:
        place = db.create_map("moved")
        place.add_storey("s", elevation=0, height=2.7)
        for what in ("rooms", "floor", "wall", "shelf"):
            add(place, what)
        home = {name: place[name].pose.x for name in ("zzp", "qxv", "schr", *ROOMS)}  # type: ignore[union-attr]
        at = dict.fromkeys(home, 0.0)
        for turn in range(8):
            chosen = draw.sample([*at], draw.randint(1, 3))
            chosen = [*at] if turn == 6 else chosen
            by = {name: draw.choice(spots) for name in chosen}
            if turn == 7:
                by = dict.fromkeys(at, 0.0)
            names = draw.sample([*by], len(by))
            if draw.random() < 0.5:  # all in one statement
                place.execute(
                    "UPDATE placement p SET pose[1] = p.pose[1] + d.by FROM entity e, "
                    "unnest(%s::text[], %s::float[]) d (name, by) "
                    "WHERE e.id = p.entity_id AND e.name = d.name AND e.map_id = current_map()",
                    names,
                    [by[name] - at[name] for name in names],
                )
            else:
                for name in names:
                    pose = place[name].pose
                    assert pose is not None
                    place[name].move_to(pose.x + by[name] - at[name], pose.y, pose.z)
            now = {name: place[name].pose for name in at}
            fresh = db.create_map(f"put {turn}")
            fresh.add_storey("s", elevation=0, height=2.7)
            for name, pose in now.items():
                assert pose is not None
                at[name] = pose.x - home[name]
                if name in ROOMS:
                    x0, x1 = (x + at[name] for x in ROOMS[name])
                    outline = [(x0, 0), (x1, 0), (x1, 8), (x0, 8)]
                    fresh.add_room(name, outline, floor=0, ceiling=2.7)
                else:
                    (size,) = (each[1] for each in (WALL, FLOOR, SHELF) if each[0] == name)
                    fresh.add_object(name, size=size, pose=(pose.x, pose.y, pose.z, 0.0))
            assert types(place) == types(fresh), at


def test_an_outer_wall_in_one_piece_encloses_rooms_and_its_absence_is_said(database: str) -> None:
    whole, space = shapely.box(-0.2, -0.2, 10.2, 8.2), shapely.box(0, 0, 10, 8)
    inner = [shapely.box(5, 0, 5.1, 3), shapely.box(5, 4, 5.1, 8)]
    with semmap.connect(database) as db:
        place = db.create_map("ring")
        place.add_storey("s", elevation=0, height=2.7)
        for number, outline in enumerate(inner):
            mesh = prism_mesh(outline, 0, 2.7)
            place.add_object(f"zzp{number}", mesh=mesh, pose=(0, 0, 0, 0))
        with pytest.raises(ValueError, match="the walls of s enclose no room: those of its border"):
            place.find_rooms()
        ring = prism_mesh(whole - space, 0, 2.7)
        place.add_object("qxv", mesh=ring, pose=(0, 0, 0, 0))
        (found,) = place.find_rooms(add=True)
        known = [shapely.box(0, 0, 5, 8), shapely.box(5.1, 0, 10, 8)]
        rooms = score_rooms(known, [room.outline for room in found.rooms])
        assert (rooms.recall, rooms.precision, len(found.doorways)) == (1, 1, 1)
        assert {place[name].type for name in ("zzp0", "zzp1", "qxv")} == {"wall"}
