"""Observation areas: where a robot stands to observe an object (Deeken et al., section 3.4)."""

from __future__ import annotations

from shapely import MultiPolygon, Polygon

_SEGMENTS = 16


def observation_area(
    footprint: Polygon | MultiPolygon,
    near: float,
    far: float,
    room: Polygon | MultiPolygon | None = None,
) -> Polygon | MultiPolygon:
    """Return the ring from `near` to `far` metres around a footprint, within its room.

    Raises ValueError: not 0 <= near < far, or the ring does not meet the room.
    """
    if not 0 <= near < far < float("inf"):
        raise ValueError(f"an observation area from {near} to {far} m: give 0 <= near < far")
    around = footprint.buffer(far, quad_segs=_SEGMENTS)
    ring: Polygon | MultiPolygon = around.difference(footprint.buffer(near, quad_segs=_SEGMENTS))
    if room is not None:
        ring = ring.intersection(room)
        if ring.area < 1e-4:
            raise ValueError(
                f"no part of the room is {near} to {far} m away from it: give smaller distances"
            )
    return ring
