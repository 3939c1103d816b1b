"""The models of the office: what they look like, and in which format each is written.

Every model stands on z = 0 about its own origin, and its front looks along +x: one sits down at a
desk from +x, and what stands against a wall has its back at -x.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import shapely
from solids import STAR, Solid, ball, box, cylinder, legs, prism, together, turned, without

BOARD = 0.02


@dataclass(frozen=True)
class Model:
    """A model: its mesh and format, or the boxes that the SDF file itself describes.

    `support` are the heights of surfaces that things stand on.
    """

    make: Callable[[], Solid] | None
    ending: str = ".obj"
    boxes: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = ()
    support: tuple[float, ...] = ()


def desk() -> Solid:
    """1.6 x 0.8 m, 0.74 m high, the top 3 cm thick, a low panel at its back."""
    return together(
        box((0.8, 1.6, 0.03), (0, 0, 0.71)),
        legs(0.8, 1.6, 0.71, 0.05, 0.02),
        box((0.02, 1.4, 0.30), (-0.34, 0, 0.41)),
    )


def kitchen_table() -> Solid:
    """A table of 0.9 x 1.4 m, 0.75 m high, on four legs."""
    return together(box((0.9, 1.4, 0.04), (0, 0, 0.71)), legs(0.9, 1.4, 0.71, 0.07, 0.03))


def conference_table() -> Solid:
    """A rounded top on two columns with feet."""
    top = prism(shapely.box(-0.35, -1.15, 0.35, 1.15).buffer(0.25, quad_segs=6), 0.71, 0.74)
    feet = [
        part
        for y in (-0.8, 0.8)
        for part in (box((0.7, 0.12, 0.04), (0, y, 0)), box((0.12, 0.12, 0.67), (0, y, 0.04)))
    ]
    return together(top, *feet)


def coffee_table() -> Solid:
    """A low table of 0.5 x 0.9 m on four legs."""
    return together(box((0.5, 0.9, 0.03), (0, 0, 0.39)), legs(0.5, 0.9, 0.39, 0.05, 0.02))


def lab_bench() -> Solid:
    """2 x 0.75 m and 0.9 m high, a shelf below."""
    return together(
        box((0.75, 2.0, 0.04), (0, 0, 0.86)),
        legs(0.75, 2.0, 0.86, 0.06, 0.01),
        box((0.55, 1.86, BOARD), (0, 0, 0.25)),
    )


def workbench() -> Solid:
    """1.8 x 0.7 m, 0.78 m high, on four legs that stand far in: a low robot passes beneath."""
    posts = [box((0.06, 0.06, 0.74), (x, y, 0)) for x in (-0.3, 0.3) for y in (-0.4, 0.4)]
    return together(box((0.7, 1.8, 0.04), (0, 0, 0.74)), *posts)


def office_chair() -> Solid:
    """A seat and back on a column with five feet."""
    feet = []
    for angle in STAR:
        foot = box((0.28, 0.05, 0.04), (0.15, 0, 0.06))
        foot.apply_transform(_turn(angle))
        feet += [foot, ball(0.03, (0.27 * math.cos(angle), 0.27 * math.sin(angle), 0.03))]
    seat = prism(shapely.box(-0.17, -0.17, 0.17, 0.17).buffer(0.06, quad_segs=4), 0.44, 0.51)
    back = box((0.05, 0.42, 0.50), (-0.23, 0, 0.58))
    stay = box((0.03, 0.08, 0.22), (-0.24, 0, 0.44))
    return together(*feet, cylinder(0.03, 0.36, (0, 0, 0.08)), seat, stay, back)


def chair() -> Solid:
    """Four legs, a seat 0.45 m high and a back."""
    return together(
        legs(0.42, 0.42, 0.42, 0.04, 0.0),
        box((0.42, 0.42, 0.03), (0, 0, 0.42)),
        box((0.03, 0.42, 0.40), (-0.195, 0, 0.45)),
    )


def sofa() -> Solid:
    """A seat 1.5 m wide with a back and arms, 1.9 m in all."""
    return together(
        box((0.65, 1.5, 0.42), (0.10, 0, 0)),
        box((0.20, 1.9, 0.80), (-0.325, 0, 0)),
        box((0.65, 0.20, 0.60), (0.10, 0.85, 0)),
        box((0.65, 0.20, 0.60), (0.10, -0.85, 0)),
    )


SHELF_BOARDS = (0.05, 0.45, 0.85, 1.25, 1.65)


def bookshelf() -> Solid:
    """1.2 m wide and 1.9 m high; five boards and a lid between two sides, with a back."""
    sides = [box((0.35, BOARD, 1.9), (0, y, 0)) for y in (-0.59, 0.59)]
    boards = [box((0.33, 1.16, BOARD), (0.01, 0, z - BOARD)) for z in (*SHELF_BOARDS, 1.9)]
    return together(*sides, *boards, box((BOARD, 1.16, 1.9), (-0.165, 0, 0)))


def kitchen_counter() -> Solid:
    """A counter of 2.4 m with a sink let into its top, and a tap."""
    body = box((0.60, 2.4, 0.90), (0, 0, 0))
    sink = box((0.38, 0.50, 0.18), (0.02, 0.6, 0.72))
    tap = together(
        cylinder(0.02, 0.25, (-0.24, 0.6, 0.90), 10), box((0.16, 0.03, 0.03), (-0.16, 0.6, 1.12))
    )
    return together(without(body, [sink.apply_translation((0, 0, 0.001))]), tap)


def muffin() -> Solid:
    """A cup of paper with a cap that rises above it."""
    return turned(
        [
            (0, 0),
            (0.025, 0),
            (0.034, 0.045),
            (0.041, 0.052),
            (0.038, 0.064),
            (0.024, 0.075),
            (0, 0.079),
        ]
    )


def cup() -> Solid:
    """A cup that one can look into, with a handle."""
    wall = turned([(0, 0), (0.028, 0), (0.04, 0.08), (0.036, 0.08), (0.025, 0.006), (0, 0.006)])
    handle = without(
        box((0.008, 0.03, 0.05), (0, 0.048, 0.018)), [box((0.01, 0.018, 0.034), (0, 0.046, 0.026))]
    )
    return together(wall, handle)


def plate() -> Solid:
    """A flat plate with a raised rim, 0.24 m across."""
    return turned([(0, 0), (0.07, 0), (0.12, 0.016), (0.118, 0.02), (0.07, 0.006), (0, 0.006)], 24)


def monitor() -> Solid:
    """A screen 0.56 m wide on a foot."""
    return together(
        box((0.20, 0.24, 0.012), (0, 0, 0)),
        box((0.03, 0.06, 0.16), (-0.03, 0, 0.012)),
        box((0.03, 0.56, 0.34), (0, 0, 0.13)),
    )


def laptop() -> Solid:
    """Opened, the screen leaning back a little."""
    screen = box((0.008, 0.32, 0.21), (0, 0, 0))
    screen.apply_transform(_lean(-0.25))
    screen.apply_translation((-0.105, 0, 0.012))
    return together(box((0.22, 0.32, 0.014), (0, 0, 0)), screen)


def potted_plant() -> Solid:
    """A pot with a stem and four balls of leaves."""
    pot = turned([(0, 0), (0.13, 0), (0.18, 0.32), (0.15, 0.32), (0.14, 0.27), (0, 0.27)], 16)
    leaves = [
        ball(r, (x, y, z))
        for r, x, y, z in (
            (0.24, 0.0, 0.0, 0.78),
            (0.18, 0.13, 0.1, 0.98),
            (0.17, -0.12, 0.07, 1.05),
            (0.16, 0.02, -0.14, 0.95),
        )
    ]
    return together(pot, cylinder(0.025, 0.4, (0, 0, 0.26), 8), *leaves)


def toilet() -> Solid:
    """A bowl and the cistern behind it."""
    bowl = turned(
        [(0, 0), (0.13, 0), (0.11, 0.2), (0.19, 0.4), (0.14, 0.4), (0.05, 0.22), (0, 0.22)]
    )
    bowl.apply_scale([1.25, 1.0, 1.0])
    return together(bowl, box((0.17, 0.38, 0.38), (-0.27, 0, 0.40)))


def sink() -> Solid:
    """A basin on a foot."""
    basin = without(
        box((0.42, 0.52, 0.16), (0, 0, 0.70)), [box((0.30, 0.40, 0.13), (0.02, 0, 0.74))]
    )
    return together(basin, box((0.16, 0.18, 0.70), (-0.1, 0, 0)))


def trash_can() -> Solid:
    """An open bin, 0.32 m high."""
    return turned([(0, 0), (0.11, 0), (0.14, 0.32), (0.13, 0.32), (0.105, 0.01), (0, 0.01)], 16)


def stairs_down() -> Solid:
    """A flight of ten steps that leads down along -y from its origin, 1.2 m wide."""
    rise, tread = 0.17, 0.28
    points = [(0.0, 0.0)]
    for step in range(1, 11):
        points += [((step - 1) * tread, -step * rise), (step * tread, -step * rise)]
    profile = shapely.Polygon([*points, (10 * tread, -10 * rise - 0.15), (0, -10 * rise - 0.15)])
    flight = prism(profile, -0.6, 0.6)
    flight.apply_transform(
        [[0, 0, 1, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
    )  # the profile's x becomes -y, its y becomes z
    if flight.volume < 0:
        flight.invert()
    return flight


def _turn(angle: float) -> list[list[float]]:
    c, s = math.cos(angle), math.sin(angle)
    return [[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def _lean(angle: float) -> list[list[float]]:
    c, s = math.cos(angle), math.sin(angle)
    return [[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]]


MODELS: dict[str, Model] = {
    "desk": Model(desk, support=(0.74,)),
    "kitchen_table": Model(kitchen_table, support=(0.75,)),
    "conference_table": Model(conference_table, ".dae", support=(0.74,)),
    "coffee_table": Model(coffee_table, ".stl", support=(0.42,)),
    "lab_bench": Model(lab_bench, ".stl", support=(0.27, 0.90)),
    "workbench": Model(workbench, support=(0.78,)),
    "office_chair": Model(office_chair, ".dae", support=(0.51,)),
    "chair": Model(chair, ".stl", support=(0.45,)),
    "sofa": Model(sofa, support=(0.42,)),
    "bookshelf": Model(bookshelf, support=SHELF_BOARDS),
    "kitchen_counter": Model(kitchen_counter, support=(0.90,)),
    "muffin": Model(muffin),
    "cup": Model(cup, ".glb"),
    "plate": Model(plate, ".stl"),
    "monitor": Model(monitor),
    "laptop": Model(laptop, ".stl"),
    "potted_plant": Model(potted_plant, ".dae"),
    "toilet": Model(toilet, ".dae"),
    "sink": Model(sink),
    "trash_can": Model(trash_can, ".glb"),
    "stair_flight": Model(stairs_down, ".stl"),
    "book": Model(None, boxes=(((0.17, 0.035, 0.24), (0, 0, 0)),)),
    "tray": Model(None, boxes=(((0.32, 0.46, 0.015), (0, 0, 0)),), support=(0.015,)),
    "refrigerator": Model(
        None, boxes=(((0.64, 0.60, 1.80), (0, 0, 0)), ((0.03, 0.03, 0.50), (0.335, 0.24, 0.9)))
    ),
    "microwave": Model(None, boxes=(((0.36, 0.48, 0.28), (0, 0, 0)),), support=(0.28,)),
    "coffee_machine": Model(
        None,
        boxes=(
            ((0.14, 0.24, 0.36), (-0.11, 0, 0)),
            ((0.36, 0.24, 0.04), (0, 0, 0)),
            ((0.30, 0.24, 0.12), (-0.03, 0, 0.24)),
        ),
    ),
    "whiteboard": Model(
        None, boxes=(((0.03, 1.8, 1.1), (0, 0, 0)), ((0.08, 1.2, 0.02), (0.055, 0, 0)))
    ),
    "printer": Model(None, boxes=(((0.50, 0.56, 0.95), (0, 0, 0)),)),
}
