"""What a region map measures: overlaps, neighbours, support and memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True)
class Overlap:
    """The space that two entities share: a number of voxels, and a volume in cubic metres."""

    voxels: int
    volume: float


class Neighbour(NamedTuple):
    """How one entity is placed relative to another."""

    shared: int  # number of voxels that both have
    # distance in voxels between the two nearest voxels as cubes; 0 where these touch, even if only
    # at a corner
    gap: float


class Support(NamedTuple):
    """How many voxels of the lowest layer of an entity rest on another entity.

    A voxel rests on an entity that has the voxel below it or the same voxel, but not the voxel
    above; so of two that begin at one height only the higher can rest on the other. All numbers are
    0 where an entity begins too low.
    """

    layer: int  # number of voxels in the lowest layer
    firm: int  # number of those that rest on the other entity
    loose: int  # number of those that rest on it if the entity is shifted up or down by a voxel


@dataclass(frozen=True)
class Memory:
    """The memory of a region map in bytes, and what it contains.

    `grid` is that of the voxels, `index` that of the list of blocks of each entity, `sets` that of
    the register of sets. `leaves` are blocks of 8 x 8 x 8 voxels with several sets, `tiles` such
    with one set.
    """

    grid: int
    index: int
    sets: int
    active_voxels: int
    leaves: int
    tiles: int
    set_count: int

    @property
    def bytes_per_voxel(self) -> float:
        """All bytes divided by the active voxels; NaN where there are none."""
        whole = self.grid + self.index + self.sets
        return whole / self.active_voxels if self.active_voxels else float("nan")
