"""Inventories from geometry: what lies on which surface, what stands in which room.

Deeken et al., section 3.4: objects are "already implicitly bound by their pose"; this makes it
explicit, with a confidence where it is close.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, STRtree

CONTACT = 0.03
"""Metres between a thing's bottom and a surface within which it lies on it."""

HALF = 0.5 - 1e-9
"""Share of a footprint that holds it."""

WALKED = 0.5
"""Square metres beyond which something flat is walked over."""

CLEAR = 0.95
"""Share of a footprint from which there is no doubt."""


@dataclass(frozen=True, eq=False)
class Item:
    """An object in world coordinates: 3D box (2, 3) and footprint."""

    id: int
    box: NDArray[np.float64]
    footprint: Polygon | MultiPolygon


@dataclass(frozen=True, eq=False)
class SurfacePatch:
    """A support surface in world coordinates: whose it is, and how low that one reaches."""

    owner: int
    low: float
    height: float
    outline: Polygon


@dataclass(frozen=True, eq=False)
class RoomSpace:
    """A room in world coordinates: outline, floor and ceiling height."""

    id: int
    outline: Polygon | MultiPolygon
    low: float
    high: float


@dataclass(frozen=True)
class Holding:
    """Who holds a thing, how, and how sure that is (0..1)."""

    holder: int | None
    confidence: float
    relation: Literal["in", "on"]


def derive_holders(
    things: Sequence[Item], surfaces: Sequence[SurfacePatch], rooms: Sequence[RoomSpace]
) -> dict[int, Holding]:
    """The holder of each thing: the surface it lies on, else the room it stands in, else none.

    A thing lies on a surface whose height is within `CONTACT` of its bottom and which bears at
    least half of its footprint, on the highest into which it has not sunk; else on the largest of
    those that touch it, within a third of `CONTACT`, if its middle is between them. What one walks
    over (flatter than `CONTACT`, larger than `WALKED`: a carpet) holds nothing, a tray does. A
    holder's bottom is below that of what it holds, so that no two things hold each other. A thing
    stands in the room with most of its footprint, at least half, whose heights take in its middle.
    """
    known = {thing.id: thing for thing in things}
    bearing = [s for s in surfaces if _bears(s, known.get(s.owner))]
    surface_tree = STRtree([s.outline for s in bearing])
    room_tree = STRtree([r.outline for r in rooms])
    held = {}
    for thing in things:
        held[thing.id] = (
            _on(thing, bearing, surface_tree)
            or _in(thing, rooms, room_tree)
            or Holding(None, 1.0, "in")
        )
    return held


def _bears(surface: SurfacePatch, owner: Item | None) -> bool:
    if owner is None:
        return True
    low, high = owner.box[:, 2]
    return bool(high - low > CONTACT or owner.footprint.area < WALKED)


def _on(thing: Item, surfaces: Sequence[SurfacePatch], tree: STRtree) -> Holding | None:
    bottom, area = thing.box[0, 2], thing.footprint.area
    shares: dict[int, float] = {}
    rises: dict[int, float] = {}
    for i in tree.query(thing.footprint):
        surface = surfaces[i]
        rise = surface.height - bottom
        if (
            surface.owner == thing.id
            or abs(rise) > CONTACT
            or surface.low >= bottom - 1e-6
            or area == 0
        ):
            continue
        share = surface.outline.intersection(thing.footprint).area / area
        shares[surface.owner] = min(shares.get(surface.owner, 0.0) + share, 1.0)
        rises[surface.owner] = min(rises.get(surface.owner, rise), rise, key=abs)
    if not shares:
        return None
    bearers = [owner for owner, share in shares.items() if share >= HALF]
    if not bearers:
        touched = {
            o: share for o, share in shares.items() if share and abs(rises[o]) <= CONTACT / 3
        }
        base = shapely.union_all(
            [
                surfaces[i].outline
                for i in tree.query(thing.footprint)
                if surfaces[i].owner in touched
            ]
        )
        base = shapely.convex_hull(shapely.intersection(base, thing.footprint))
        if not touched or base.distance(thing.footprint.centroid) > 1e-6:
            return None
        return Holding(max(touched, key=lambda owner: (touched[owner], -owner)), 0.5, "on")
    best = max(
        bearers,
        key=lambda o: (rises[o] <= CONTACT / 3, round(rises[o], 3), round(shares[o], 3), -o),
    )
    gap = abs(rises[best])
    sure = (
        1.0
        if shares[best] >= CLEAR and gap <= CONTACT / 3
        else shares[best] * (1 - gap / (2 * CONTACT))
    )
    return Holding(best, float(sure), "on")


def _in(thing: Item, rooms: Sequence[RoomSpace], tree: STRtree) -> Holding | None:
    middle, area = thing.box[:, 2].mean(), thing.footprint.area
    shares = {
        rooms[i].id: shapely.intersection(rooms[i].outline, thing.footprint).area / area
        for i in tree.query(thing.footprint)
        if rooms[i].low - CONTACT <= middle <= rooms[i].high + CONTACT and area > 0
    }
    if not shares:
        return None
    best = max(shares, key=lambda room: (shares[room], -room))
    if shares[best] < HALF:
        return None
    return Holding(best, 1.0 if shares[best] >= CLEAR else float(shares[best]), "in")
