"""One grid for all: which set of entities each voxel belongs to.

Source: "VDB-based Spatially Grounded Semantics for Interactive Robots", sections III-A and III-B.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import semmap_vdb
from semmap.fields.regions.shapes import Region, _above_0, _points, shape_of

__all__ = ["Memory", "Neighbour", "Overlap", "RegionMap", "Support"]

_FARTHEST = 1000


@dataclass(frozen=True)
class Overlap:
    """What two entities share: how many voxels, and their volume in cubic metres."""

    voxels: int
    volume: float


class Neighbour(NamedTuple):
    """How another entity lies to one.

    Attributes
    ----------
    shared : int
        Voxels of both.
    gap : float
        Voxels between the nearest two as cubes; 0 where these meet, if only by a corner.
    """

    shared: int
    gap: float


class Support(NamedTuple):
    """How many voxels the lowest layer of an entity has, and how many of them rest on another.

    A voxel rests on what has the voxel beneath it or the same one, but not the one above. Of two
    that begin at one height, only what reaches higher can rest on the other. All are 0 where an
    entity begins too low to rest on the other.

    Attributes
    ----------
    layer, firm : int
        All, and those that rest.
    loose : int
        Those that rest if the entity is taken for a voxel higher or lower than it is.
    """

    layer: int
    firm: int
    loose: int


@dataclass(frozen=True)
class Memory:
    """What a map holds, in bytes, and of how much.

    Attributes
    ----------
    grid, index, sets : int
        Bytes of the voxels, of each entity's own list of blocks, and of the register of sets.
    active_voxels, leaves, tiles, set_count : int
        Voxels in at least one entity; blocks of 8 x 8 x 8 that hold several sets, and those of one;
        sets in use.
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
        """All bytes by active voxels; NaN where there are none."""
        whole = self.grid + self.index + self.sets
        return whole / self.active_voxels if self.active_voxels else float("nan")


class RegionMap:
    """Which entities are where, on a grid of voxels.

    Each voxel holds the number of a set; a register turns it into the set of entities. A number
    stays that of its set while a voxel holds it. May be used by several threads.

    Parameters
    ----------
    voxel_size : float
        Metres.
    threads : int, optional
        How many `insert_many` may use; all processors if not given. The result is the same.
    """

    def __init__(self, voxel_size: float, *, threads: int | None = None) -> None:
        self._native = semmap_vdb.RegionMap(_above_0(voxel_size, "voxel_size"))
        self._voxel_size = float(voxel_size)
        self._threads = (os.cpu_count() or 1) if threads is None else int(threads)
        if self._threads < 1:
            raise ValueError(f"threads is {threads}: give at least 1")
        self._number: dict[Hashable, int] = {}
        self._entity: list[Hashable] = []
        self._free: list[int] = []
        # Numbers and entities change together.
        self._lock = threading.RLock()

    @property
    def voxel_size(self) -> float:
        """Metres."""
        return self._voxel_size

    def __contains__(self, entity: object) -> bool:
        """True for an entity that has voxels."""
        return entity in self._number

    def __len__(self) -> int:
        """How many entities have voxels."""
        return len(self._number)

    def entities(self) -> set[Hashable]:
        """Those that have voxels."""
        with self._lock:
            return set(self._number)

    def insert(self, entity: Hashable, region: Region) -> None:
        """Add a region to what the entity has.

        Raises
        ------
        ValueError
            The region has more voxels than `semmap.limits` allow; the map is as before.
        """
        shape = shape_of(region)
        with self._lock:
            number = self._hand_out(entity)
            try:
                self._native.insert(number, shape)
            except ValueError as error:
                raise ValueError(f"{entity}: {error}") from None
            finally:
                self._forget_if_empty(entity)

    def insert_many(
        self, regions: Mapping[Hashable, Region] | Iterable[tuple[Hashable, Region]]
    ) -> None:
        """Add many regions in one pass; an entity may be named more than once.

        Raises
        ------
        ValueError
            As by `insert`, of the first such region; none is added.
        """
        left_out = self._insert_many(regions, others=False)
        for entity, reason in left_out.items():
            raise ValueError(f"{entity}: {reason}")

    def insert_possible(
        self, regions: Mapping[Hashable, Region] | Iterable[tuple[Hashable, Region]]
    ) -> dict[Hashable, str]:
        """Add many regions; why an entity is left out whose regions have too many voxels."""
        pairs = list(regions.items() if isinstance(regions, Mapping) else regions)
        left_out = self._insert_many(pairs, others=True)
        for entity in left_out:
            self.remove(entity)
        return left_out

    def _insert_many(
        self,
        regions: Mapping[Hashable, Region] | Iterable[tuple[Hashable, Region]],
        *,
        others: bool,
    ) -> dict[Hashable, str]:
        pairs = list(regions.items() if isinstance(regions, Mapping) else regions)
        shapes = [shape_of(region) for _, region in pairs]
        with self._lock:
            numbers = [self._hand_out(entity) for entity, _ in pairs]
            try:
                reasons = self._native.insert_many(numbers, shapes, self._threads, others)
            finally:
                for entity, _ in pairs:
                    self._forget_if_empty(entity)
        found = zip((entity for entity, _ in pairs), reasons, strict=True)
        return {entity: reason for entity, reason in found if reason}

    def remove(self, entity: Hashable) -> None:
        """Take an entity out; an unknown one is not there to take out."""
        with self._lock:
            number = self._number.get(entity)
            if number is not None:
                self._native.remove(number)
                self._forget_if_empty(entity)

    def move(self, entity: Hashable, region: Region) -> None:
        """Give an entity another region in place of what it has; an unknown one is put in."""
        shape = shape_of(region)
        with self._lock:
            number = self._hand_out(entity)
            try:
                self._native.move(number, shape)
            except ValueError as error:
                raise ValueError(f"{entity}: {error}") from None
            finally:
                self._forget_if_empty(entity)

    def set_numbers_at(self, points: ArrayLike) -> NDArray[np.int32]:
        """(N,) the number of the set at each of (N, 3) points; 0 where there is no entity."""
        return self._native.set_numbers_at(_points(points, "points"))

    def sets(self, numbers: ArrayLike) -> dict[int, frozenset[Hashable]]:
        """The set of each of the given numbers; empty for one that is not in use."""
        wanted: list[int] = np.unique(np.asarray(numbers, dtype=np.int32)).tolist()
        with self._lock:
            members = self._native.members(wanted)
            return {
                number: frozenset(self._entity[i] for i in each)
                for number, each in zip(wanted, members, strict=True)
            }

    def entities_at(self, points: ArrayLike) -> list[set[Hashable]]:
        """The set of entities at each of (N, 3) points in metres."""
        with self._lock:
            numbers = self.set_numbers_at(points)
            sets = self.sets(numbers)
        return [set(sets[number]) for number in numbers.tolist()]

    def voxels(self, entity: Hashable) -> NDArray[np.int32]:
        """(N, 3) the voxels of an entity, each once; none of an unknown one."""
        with self._lock:
            number = self._number.get(entity)
            if number is None:
                return np.zeros((0, 3), np.int32)
            return self._native.voxels(number)

    def entities_in(self, region: Region) -> set[Hashable]:
        """The entities that share a voxel with a region."""
        return set(self.counts_in(region))

    def counts_in(self, region: Region) -> dict[Hashable, int]:
        """How many of the voxels of a region each entity has that has one."""
        shape = shape_of(region)
        with self._lock:
            return {self._entity[i]: count for i, count in self._native.entities_in(shape)}

    def overlap(self, a: Hashable, b: Hashable) -> Overlap:
        """What two entities share; nothing where one is unknown."""
        with self._lock:
            one, other = self._number.get(a), self._number.get(b)
            shared = 0 if one is None or other is None else self._native.overlap(one, other)
        return Overlap(shared, shared * self._voxel_size**3)

    def size(self, entity: Hashable) -> int:
        """How many voxels an entity has; 0 of an unknown one."""
        with self._lock:
            number = self._number.get(entity)
            return 0 if number is None else self._native.size(number)

    def neighbours(self, entity: Hashable, reach: float | None = None) -> dict[Hashable, Neighbour]:
        """The others around an entity; none of an unknown one.

        What is further away costs nothing.

        Parameters
        ----------
        reach : float, optional
            Metres of gap, up to 1,000 voxels. If not given: only those that share a voxel.
        """
        farthest = -1
        if reach is not None:
            if not 0 <= reach <= _FARTHEST * self._voxel_size:
                raise ValueError(
                    f"reach is {reach!r}: give metres from 0 to {_FARTHEST * self._voxel_size:g} "
                    f"({_FARTHEST} voxels), or None"
                )
            farthest = math.floor((reach / self._voxel_size) ** 2 * (1 + 1e-9))
        with self._lock:
            number = self._number.get(entity)
            if number is None:
                return {}
            return {
                self._entity[other]: Neighbour(shared, math.sqrt(gap))
                for other, shared, gap in self._native.neighbours(number, farthest)
            }

    def support(self, a: Hashable, b: Hashable) -> Support:
        """How much of the underside of one entity rests on another; nothing if one is unknown."""
        with self._lock:
            one, other = self._number.get(a), self._number.get(b)
            if one is None or other is None:
                return Support(0, 0, 0)
            return Support(*self._native.support(one, other))

    def memory(self) -> Memory:
        """Bytes, and what they hold."""
        m = self._native.memory()
        return Memory(m.grid, m.index, m.sets, m.active_voxels, m.leaves, m.tiles, m.set_count)

    def check(self) -> None:
        """Compare numbers, counts and indices with the whole grid, for tests."""
        self._native.check()

    def write(self, path: str | Path) -> None:
        """Write the set numbers as a `.vdb` file."""
        self._native.write(str(path))

    def state(self) -> tuple[semmap_vdb.Int32Grid, dict[int, list[Hashable]]]:
        """All of it, to be kept: the number of each voxel's set, and the members of each set."""
        with self._lock:
            grid, sets = self._native.state()
            return grid, {number: [self._entity[i] for i in each] for number, each in sets}

    @classmethod
    def from_state(
        cls,
        grid: semmap_vdb.Int32Grid,
        sets: Mapping[int, Iterable[Hashable]],
        *,
        threads: int | None = None,
    ) -> RegionMap:
        """The map that had such a `state`; sets have the numbers that they had.

        Raises
        ------
        ValueError
            Grid and sets do not belong together.
        """
        made = cls(grid.voxel_size, threads=threads)
        rows = [
            (number, sorted({made._hand_out(entity) for entity in members}))
            for number, members in sets.items()
        ]
        made._native.restore(grid, rows)
        return made

    def _hand_out(self, entity: Hashable) -> int:
        number = self._number.get(entity)
        if number is None:
            if self._free:
                number = self._free.pop()
                self._entity[number] = entity
            else:
                number = len(self._entity)
                self._entity.append(entity)
            self._number[entity] = number
        return number

    def _forget_if_empty(self, entity: Hashable) -> None:
        number = self._number.get(entity)
        if number is not None and not self._native.has(number):
            del self._number[entity]
            self._entity[number] = None
            self._free.append(number)
