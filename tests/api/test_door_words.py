"""Random doors: what a route refuses `check` names, with the robot that passes, and nothing else.

The oracle is arithmetic on the numbers that the doors were drawn with.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field

import pytest
import shapely

import semmap

WIDTH, HEIGHT, STEP = 0.6, 1.5, 0.021  # of the body that is assumed


@dataclass
class Drawn:
    """A door of a width, and boxes in it: their name, ends across it, and heights."""

    width: float
    boxes: list[tuple[str, float, float, float, float]] = field(default_factory=list)

    def passes(self, wide: float = WIDTH, high: float = HEIGHT, step: float = STEP) -> bool:
        """Whether a robot gets through somewhere."""
        met = [(a, b) for _, a, b, low, top in self.boxes if low <= high and top >= step]
        free = shapely.LineString([(-self.width / 2, 0), (self.width / 2, 0)])
        for a, b in met:
            free = free.difference(shapely.box(a, -1, b, 1))
        return any(part.length >= wide - 1e-7 for part in shapely.get_parts(free))

    def words(self) -> str:
        """What is to be said of the first cause that explains all."""
        boxes = [b for b in self.boxes if b[4] >= STEP]
        sills = sorted(top for *_, top in boxes if top <= 0.2)
        for sill in sills:
            if self.passes(step=sill + 1e-5):
                return f"climbs {sill:.3f} m"
        for low in sorted((low for *_, low, _ in boxes), reverse=True):
            if low > 0.1 and self.passes(high=low - 1e-5):
                return f"lower than {low:.2f} m"
        wide = [w / 1000 for w in range(200, 601) if self.passes(wide=w / 1000)]
        if wide:
            return f"narrower than {wide[-1]:.2f}"
        return "passes"


def drawn(draw: random.Random) -> Drawn:
    width = draw.choice([0.5, 0.6, 0.7, 0.9, 1.0, round(draw.uniform(0.6, 1.4), 3)])
    half, kinds = width / 2, draw.sample(["sill", "lintel", "post", "none"], draw.randint(1, 2))
    door = Drawn(width)
    if width <= WIDTH:  # posts and frames of narrow doors are nearly all of it
        return door
    if "sill" in kinds:
        door.boxes.append(("sill", -half, half, 0.0, draw.choice([0.02, 0.022, 0.05, 0.1, 0.3])))
    if "lintel" in kinds:
        low = draw.choice([1.0, 1.499, 1.5, 1.502, 1.9])
        door.boxes.append(("lintel", -half, half, low, 2.6))
    if "post" in kinds:
        gap = draw.choice([0.3, 0.53, 0.59, 0.6, 0.61, 0.62, 0.65])
        if gap < width:
            side = draw.choice([-1, 1])
            low, high = sorted((side * (half - gap), -side * half))
            door.boxes.append(("post", low, high, 0.0, draw.choice([1.0, 2.0])))
    return door


@pytest.mark.parametrize("seed", range(3))
def test_check_names_what_a_route_refuses(database: str, seed: int) -> None:
    draw = random.Random(seed)
    doors = {f"d{k}": drawn(draw) for k in range(20)}
    with semmap.connect(database) as db:
        place = db.create_map("doors")
        place.add_storey("ground", height=3)
        for number, (name, door) in enumerate(doors.items()):
            y, x, half = 5 * number + draw.uniform(0, 0.2), draw.uniform(0, 0.1), door.width / 2
            place.add_room(f"a{name}", shapely.box(x, y, x + 3, y + 4), floor=0, ceiling=2.6)
            place.add_room(f"b{name}", shapely.box(x + 3.2, y, x + 6, y + 4), floor=0, ceiling=2.6)
            line = ((x + 3.1, y + 2 - half), (x + 3.1, y + 2 + half))
            place.add_door(name, f"a{name}", f"b{name}", line)
            walls = [("w", -2.0, -half, 0.0, 2.6), ("v", half, 2.0, 0.0, 2.6)]
            for solid, low, high, bottom, top in [*walls, *door.boxes]:
                place.add_object(
                    f"{solid} of {name}",
                    type="wall" if solid in ("w", "v", "lintel") else "box",
                    size=(0.2, high - low, top - bottom),
                    pose=(x + 3.1, y + 2 + (low + high) / 2, bottom),
                )
        kinds = ("blocked door", "narrow door", "thing in a doorway", "no passage")
        found = {f.entities[0]: f for f in place.check() if f.kind in kinds}
        for name, door in doors.items():
            try:
                place.route(f"a{name}", f"b{name}")
            except ValueError:
                routed = False
            else:
                routed = True
            assert (name not in found) == door.passes() == routed, (door, found.get(name))
            if name in found:
                assert found[name].severity in ("warning", "error")
                assert door.words() in found[name].text, door
        assert 5 < len(found) < 19
