"""OFFICE-40x25: an office floor of 40 x 25 x 2.8 m as closed solids, the same on each run.

Sixteen rooms along a corridor, and in each four desks with monitors and chairs, a cupboard, a thin
shelf, a ball and a tilted pole. A target edge of 0.285 m gives 191,924 triangles, 0.0827 m gives
1,996,812.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh

__all__ = ["HEIGHT", "Box", "Pole", "Solid", "Sphere", "meshes", "solids"]

Floats = NDArray[np.float64]

HEIGHT = 2.8
_WALL = 0.15
_OFF_GRID = 0.013  # no wall lies on a border of cells of 5 cm
_DOOR, _DOOR_TOP = 1.0, 2.1


@dataclass(frozen=True)
class Box:
    """A box, turned by `yaw` about the upright line through `centre`."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    yaw: float = 0.0
    centre: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Sphere:
    """A sphere."""

    centre: tuple[float, float, float]
    radius: float


@dataclass(frozen=True)
class Pole:
    """A cylinder from one point to another."""

    foot: tuple[float, float, float]
    head: tuple[float, float, float]
    radius: float


Solid = Box | Sphere | Pole


def solids() -> list[Solid]:
    """All solids of the office."""
    return [*_shell(), *_furniture(), Box((8.0, 12.3, 0), (9.2, 13.1, 2)), _DUCT]


_DUCT = Box((30.0, 12.2, 1.38), (33.0, 12.5, 1.43))  # across the upper end of the interval


def _shell() -> Iterator[Box]:
    yield Box((0, 0, -0.2), (40, 25, 0))
    yield Box((0, 0, HEIGHT), (40, 25, HEIGHT + 0.2))
    edge = 0.1 + _OFF_GRID
    yield from _wall(0, edge, (0.1, 39.9), doors=(20.0,))
    yield from _wall(0, 25 - edge, (0.1, 39.9))
    yield from _wall(1, edge, (0.2, 24.8))
    yield from _wall(1, 40 - edge, (0.2, 24.8))
    for y in (11.25, 13.75):
        yield from _wall(0, y + _OFF_GRID, (0.2, 39.8), doors=[2.5 + 5 * i for i in range(8)])
    for i in range(1, 8):
        for span in ((0.2, 11.17), (13.83, 24.8)):
            yield from _wall(1, 5 * i + _OFF_GRID, span)


def _wall(
    axis: int, across: float, span: tuple[float, float], doors: Sequence[float] = ()
) -> Iterator[Box]:
    """The pieces of a wall along an axis, with a lintel over each door."""

    def piece(begin: float, end: float, low: float) -> Box:
        a, b = [begin, across - _WALL / 2], [end, across + _WALL / 2]
        if axis == 1:
            a, b = a[::-1], b[::-1]
        return Box((a[0], a[1], low), (b[0], b[1], HEIGHT))

    begin = span[0]
    for door in doors:
        yield piece(begin, door - _DOOR / 2, 0)
        yield piece(door - _DOOR / 2, door + _DOOR / 2, _DOOR_TOP)
        begin = door + _DOOR / 2
    yield piece(begin, span[1], 0)


def _furniture() -> Iterator[Solid]:
    random = np.random.default_rng(42)
    for y0, y1 in ((0.4, 10.9), (14.1, 24.6)):
        for i in range(8):
            middle = 5 * i + 2.5
            for k in range(4):
                x = middle + random.uniform(-1.3, 1.3)
                y = y0 + 1.3 + (y1 - y0 - 2.6) * k / 3 + random.uniform(-0.2, 0.2)
                yield from _desk(x, y, random.uniform(-0.5, 0.5))
                x += random.uniform(-0.3, 0.3)
                yield from _chair(x, y - 0.75, random.uniform(-3, 3))
            yield Box((middle - 2.2, y0 + 0.05, 0), (middle - 1.3, y0 + 0.5, 1.9))
            # between planes at every 5 cm
            yield Box((middle + 1.0, y1 - 0.35, 0.96), (middle + 2.2, y1 - 0.05, 0.975))
            yield Sphere((middle + 1.9, y0 + 0.6, 0.5), 0.3)
            yield Pole((middle - 1.8, y1 - 0.6, 0), (middle - 1.3, y1 - 1.2, 1.6), 0.02)


def _desk(x: float, y: float, yaw: float) -> Iterator[Box]:
    here = (x, y)
    yield Box((x - 0.8, y - 0.4, 0.72), (x + 0.8, y + 0.4, 0.75), yaw, here)
    yield from _legs(x, y, (0.75, 0.35), 0.025, 0.72, yaw)
    yield Box((x - 0.3, y + 0.15, 0.8), (x + 0.3, y + 0.18, 1.15), yaw, here)


def _chair(x: float, y: float, yaw: float) -> Iterator[Box]:
    here = (x, y)
    yield Box((x - 0.22, y - 0.22, 0.43), (x + 0.22, y + 0.22, 0.47), yaw, here)
    yield Box((x - 0.22, y + 0.18, 0.47), (x + 0.22, y + 0.22, 0.95), yaw, here)
    yield from _legs(x, y, (0.19, 0.19), 0.015, 0.43, yaw)


def _legs(
    x: float, y: float, apart: tuple[float, float], half: float, top: float, yaw: float
) -> Iterator[Box]:
    for dx in (-apart[0], apart[0]):
        for dy in (-apart[1], apart[1]):
            low = (x + dx - half, y + dy - half, 0.0)
            yield Box(low, (x + dx + half, y + dy + half, top), yaw, (x, y))


def meshes(edge: float) -> list[Mesh]:
    """A closed mesh of each solid, with edges of about that length in metres."""
    return [_mesh(solid, edge) for solid in solids()]


def _mesh(solid: Solid, edge: float) -> Mesh:
    match solid:
        case Box():
            return _box(solid, edge)
        case Sphere():
            around = max(8, int(np.ceil(2 * np.pi * solid.radius / edge)))
            polar = np.linspace(0, np.pi, max(4, around // 2) + 1)
            turn = _turn(around)
            ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(around)], -1)
            up = np.array([0.0, 0.0, 1.0])
            rings = np.sin(polar)[:, None, None] * ring + np.cos(polar)[:, None, None] * up
            return _lathe(rings * solid.radius + np.array(solid.centre))
        case Pole():
            foot, head = np.array(solid.foot), np.array(solid.head)
            axis = head - foot
            along = axis / np.linalg.norm(axis)
            u = np.cross(along, (0, 1, 0))
            u /= np.linalg.norm(u)
            around = max(8, int(np.ceil(2 * np.pi * solid.radius / edge)))
            pieces = max(1, int(np.ceil(np.linalg.norm(axis) / edge)))
            turn = _turn(around)
            ring = np.outer(np.cos(turn), u) + np.outer(np.sin(turn), np.cross(along, u))
            ring *= solid.radius
            shares = np.arange(pieces + 1) / pieces
            sides = foot + shares[:, None, None] * axis + ring
            ends = [np.broadcast_to(p, (1, around, 3)) for p in (foot, head)]
            return _lathe(np.concatenate([ends[0], sides, ends[1]]))


def _turn(count: int) -> Floats:
    return np.asarray(np.arange(count) * (2 * np.pi / count), float)


def _box(box: Box, edge: float) -> Mesh:
    low, high = np.array(box.low, float), np.array(box.high, float)
    steps = [max(1, int(n)) for n in np.ceil((high - low) / edge)]
    ticks = [np.linspace(low[k], high[k], steps[k] + 1) for k in range(3)]
    vertices, faces, count = [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side, at in ((0, low[axis]), (1, high[axis])):
            points = np.empty((steps[u] + 1, steps[v] + 1, 3))
            points[..., u], points[..., v] = ticks[u][:, None], ticks[v]
            points[..., axis] = at
            index = np.arange(points.size // 3).reshape(points.shape[:2]) + count
            count += index.size
            triangles = _quads(index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
            vertices.append(points.reshape(-1, 3))
            faces.append(triangles if side else triangles[:, ::-1])
    corners = np.concatenate(vertices)
    if box.yaw:
        x, y = corners[:, 0] - box.centre[0], corners[:, 1] - box.centre[1]
        cos, sin = np.cos(box.yaw), np.sin(box.yaw)
        corners[:, 0] = x * cos - y * sin + box.centre[0]
        corners[:, 1] = x * sin + y * cos + box.centre[1]
    return Mesh(corners, np.concatenate(faces).astype(np.int32))


def _lathe(rings: Floats) -> Mesh:
    """A closed surface of rings, the first and the last of which are points."""
    index = np.arange(rings.shape[0] * rings.shape[1]).reshape(rings.shape[:2])
    index[0], index[-1] = index[0, 0], index[-1, 0]
    following = np.roll(index, -1, axis=1)
    faces = _quads(index[:-1], index[1:], following[1:], following[:-1])
    a, b, c = faces.T
    return Mesh(rings.reshape(-1, 3), faces[(a != b) & (b != c) & (c != a)].astype(np.int32))


def _quads(
    a: NDArray[np.int64], b: NDArray[np.int64], c: NDArray[np.int64], d: NDArray[np.int64]
) -> NDArray[np.int64]:
    a, b, c, d = (q.ravel() for q in (a, b, c, d))
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
