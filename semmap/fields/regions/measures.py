"""What a region map measures: overlaps, neighbours, support and memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True)
class Overlap:
    """The space that two entities share.

    Attributes
    ----------
    voxels : number of voxels
    volume : cubic metres
    """

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
    above. Of two entities that begin at one height, only the one that is higher can rest on the
    other. All numbers are 0 where an entity begins too low to rest on the other.
    """

    layer: int  # number of voxels in the lowest layer
    firm: int  # number of those that rest on the other entity
    loose: int  # number of those that rest on it if the entity is shifted up or down by a voxel


@dataclass(frozen=True)
class Memory:
    """The memory of a region map in bytes, and what it contains.

    Attributes
    ----------
    grid : bytes of the voxels
    index : bytes of the list of blocks of each entity
    sets : bytes of the register of sets
    active_voxels : number of voxels that belong to at least one entity
    leaves : number of blocks of 8 x 8 x 8 voxels with several sets
    tiles : number of such blocks with one set
    set_count : number of sets in use
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
